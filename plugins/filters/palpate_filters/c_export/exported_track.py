"""The parts of a track that become C: its step, its start, its settings; or the reason why it cannot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import ConfigurationError, ContactModel, Estimator, Floats, Layout, Problem, contact_force

from palpate_filters import inertial_filter, inertial_step, kinematic_start, kinematic_step
from palpate_filters.filter_tracker import RecursiveTracker
from palpate_filters.inertial_filter import InertialFilter
from palpate_filters.kinematic_filter import KinematicFilter, kinematic_process
from palpate_filters.kinematic_settings import drift_of, has_bias
from palpate_filters.kinematic_start import guess_of
from palpate_filters.process_models import InertialProcess, KinematicProcess
from palpate_filters.recursion import Recursion, output_layout
from palpate_filters.step_limits import FIT_SPREAD

_NOISE_AS_STATED = None  # in place of a measured standard deviation of force or velocity
_NOISES = (
    ("force_std", "[N] standard deviation of the force"),
    ("position_std", "[m] of the position"),
    ("velocity_std", "[m/s] of the velocity"),
    ("jerk", "[m^2/s^5] density of the tip's jerk"),
    ("surface_walk", "[m^2/s] density of the surface's height"),
    ("slope_walk", "[m^2/s^3] of its slope"),
    ("stiffness_walk", "[1/s] of the logarithm of the first parameter"),
    ("stiffness_trend", "[1/s^3] of its trend"),
    ("ratio_walk", "[1/s] of the other parameters' logarithms"),
    ("bias_walk", "[N^2/s] of the force bias"),
)


@dataclass(frozen=True)
class SettingGroup:
    """Numbers of one meaning in a struct of settings."""

    name: str
    about: str
    values: tuple[float, ...]
    array: bool = False


@dataclass(frozen=True)
class ExportedTrack:
    """An estimator on a model as its C needs it."""

    kind: str  # "kinematic" or "inertial"
    model: ContactModel
    recursion: Recursion
    state: Layout  # of the process
    carried: Layout  # by the filter
    parameters: str  # the part of the state that holds them
    mass: float  # [kg]
    window: float  # [s]
    standstill: float | None  # [s]
    measures_noise: bool
    fitted: tuple[int, ...]  # parameters that the force is proportional to
    step: tuple[SettingGroup, ...]
    start: tuple[SettingGroup, ...]
    fit_spread: float
    acceleration_std: float

    @property
    def output(self) -> Layout:
        """The layout of a step's output."""
        return output_layout(len(self.model.parameters))

    def columns(self) -> Any:
        """Return a CasADi function of depth and rate, and the guess: force of one unit of each fitted parameter."""
        import casadi as ca

        point, guess = ca.SX.sym("point", 2), ca.SX.sym("guess", len(self.model.parameters))
        memory = (ca.SX(0),) * len(self.model.memory)
        forces = []
        for fitted in self.fitted:
            theta: list[Any] = list(ca.vertsplit(guess))
            for other in self.fitted:
                theta[other] = float(other == fitted)
            forces.append(contact_force(self.model, point[0], point[1], theta, memory))
        return ca.Function("columns", [point, guess], [ca.densify(ca.vertcat(*forces))], {"cse": True})

    def chart(self) -> Any:
        """Return a CasADi function of the parameters: their chart."""
        import casadi as ca

        theta = ca.SX.sym("theta", len(self.model.parameters))
        parts: Any = ca.vertsplit(theta)
        chart = KinematicProcess(self.model, self.mass).on_chart(parts, ca.log)
        return ca.Function("chart", [theta], [ca.densify(ca.vertcat(*chart))])


def export_track(name: str, estimator: Estimator, problem: Problem) -> ExportedTrack:
    """Return the parts for C; raises ConfigurationError with the reason where an estimator has none."""
    if not isinstance(estimator, InertialFilter | KinematicFilter):
        part = type(estimator).__name__
        reason = "it needs the whole record" if not estimator.online else "it has no compiled step"
        raise ConfigurationError(
            f"track {name}: {part} cannot be exported: {reason}; ekf, afekf, ukf, afukf and kinematic-ekf can"
        )
    tracker = estimator.start(problem)
    assert isinstance(tracker, RecursiveTracker)
    fitted = tuple(i for i, parameter in enumerate(problem.model.parameters) if parameter.role is not None)
    if isinstance(estimator, KinematicFilter):
        return _kinematic(estimator, problem, tracker, fitted)
    return _inertial(estimator, problem, tracker, fitted)


def _kinematic(
    settings: KinematicFilter, problem: Problem, tracker: RecursiveTracker, fitted: tuple[int, ...]
) -> ExportedTrack:
    """Return a kinematic filter for C: the settings of its step, those of its start, its layouts.

    Its state has the parameters in a chart, by their logarithms. `fitted` are the indexes of the model's parameters
    that the fit of the start determines; `tracker` runs the filter in Python, with the same step and start.
    """
    process = kinematic_process(settings, problem)
    # The settings of a step are one vector: the noises, then depth and parameters of a restart with their deviations.
    step_settings = tracker.recursion.settings(_NOISE_AS_STATED, _NOISE_AS_STATED)
    k = len(problem.model.parameters)
    places = Layout(noises=len(_NOISES), depth=1, chart=k, depth_std=1, chart_std=k)
    step = (
        *(
            SettingGroup(name, meaning, (number,))
            for (name, meaning), number in zip(_NOISES, step_settings, strict=False)
        ),
        _setting("depth", "[m] of a restart", step_settings, places),
        _setting("chart", "logarithms of the parameters of a restart", step_settings, places),
        _setting("depth_std", "[m] its standard deviation", step_settings, places),
        _setting("chart_std", "their standard deviations", step_settings, places),
    )
    start = [
        _single("start_depth", "[m] first guess of the depth, where the fit fails", settings.start_depth),
        _single("start_spread", "standard deviation of the logarithm of a guessed parameter", settings.start_spread),
        _single("position_std", "[m] of the first position", settings.position_std),
        _single("velocity_std", "[m/s] of the first velocity", settings.velocity_std),
        _single("slope_std", "[m/s] of the first slope", kinematic_start.SLOPE_STD * settings.sweep_speed),
        _single("trend_std", "[1/s] of the first trend", kinematic_start.TREND_STD),
        SettingGroup(
            "guess", "first guesses of the parameters", tuple(guess_of(settings, process, problem).tolist()), True
        ),
    ]
    if has_bias(settings):
        start += [
            _single("force_noise", "[N] of the force, in the fit", settings.force_std),
            _single("bias_std", "[N] of the force bias at the tare", settings.bias_std),
            _single("drift", "[N/s] standard deviation of its slope", drift_of(settings)),
            _single("drift_walk", "[N/sqrt(s)] its random walk", settings.drift_walk),
        ]
    return ExportedTrack(
        kind="kinematic",
        model=problem.model,
        recursion=tracker.recursion,
        state=process.layout,
        carried=kinematic_step.state_layout(process),
        parameters="chart",
        mass=process.mass,
        window=tracker.opening.window,
        standstill=tracker.opening.standstill,
        measures_noise=tracker.opening.measure_noise,
        fitted=fitted,
        step=step,
        start=tuple(start),
        fit_spread=FIT_SPREAD,
        acceleration_std=kinematic_start.ACCELERATION_STD,
    )


def _inertial(
    settings: InertialFilter, problem: Problem, tracker: RecursiveTracker, fitted: tuple[int, ...]
) -> ExportedTrack:
    """Return a filter on the inertial process for C: the settings of its step, its guess, its layouts.

    `fitted` are the places of the parameters that the starting fit finds, since the force is proportional to them.
    """
    process = InertialProcess(problem.model, inertial_filter.moved_mass(problem), settings.order)
    # The numbers of a step's settings in one array, and the places of each group in it.
    step_settings = tracker.recursion.settings(_NOISE_AS_STATED, _NOISE_AS_STATED)
    n = process.states
    places = Layout(force_std=1, velocity_std=1, fading=4, cap=n, start=n, start_std=n)
    meanings = {
        "force_std": "[N] standard deviation of the force",
        "velocity_std": "[m/s] standard deviation of the velocity",
        "fading": "threshold of the innovation [m/s], largest factor, step up, step down",
        "cap": "upper bounds of the variances under fading",
        "start": "the state to begin from: depth [m], rate [m/s], internal states, parameters, their derivatives",
        "start_std": "standard deviations of that state",
    }
    step = tuple(_setting(name, meaning, step_settings, places) for name, meaning in meanings.items())
    guess = tuple(step_settings[places["start"]][process.parameters].tolist())
    return ExportedTrack(
        kind="inertial",
        model=problem.model,
        recursion=tracker.recursion,
        state=process.layout,
        carried=inertial_step.state_layout(process),
        parameters="parameters",
        mass=process.mass,
        window=tracker.opening.window,
        standstill=tracker.opening.standstill,
        measures_noise=tracker.opening.measure_noise,
        fitted=fitted,
        step=step,
        start=(SettingGroup("guess", "parameters that the starting fit does not find keep these", guess, array=True),),
        fit_spread=FIT_SPREAD,
        acceleration_std=0.0,  # an inertial process has no acceleration among its states
    )


def _setting(name: str, meaning: str, step_settings: Floats, places: Layout) -> SettingGroup:
    """Return the numbers of a step's settings that have a name."""
    values = np.asarray(step_settings)[places[name]].tolist()
    return SettingGroup(name, meaning, tuple(values), name not in ("force_std", "velocity_std", "depth", "depth_std"))


def _single(name: str, meaning: str, value: float) -> SettingGroup:
    """Return a setting of one number."""
    return SettingGroup(name, meaning, (value,))
