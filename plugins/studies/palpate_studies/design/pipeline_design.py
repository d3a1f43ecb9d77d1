"""Design of a palpation: from a pipeline file to bounds over frequency and amplitude."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from palpate import ConfigurationError, ContactModel, duration_of, setpoints_at, to_si
from palpate_engine import Pipeline, is_live, truth_of

from palpate_studies.design.measurement_noise import MeasurementNoise, QuantityNoise
from palpate_studies.design.palpation import Palpation, best, palpations
from palpate_studies.design.settings import DesignSettings

_NOISE = {"force_std": 0.05, "position_std": 5e-6, "velocity_std": 0.67e-3}  # [N], [m], [m/s]: the paper's rig
_RATE = 500.0  # [Hz] of a stream that does not say
_DEPTH, _DURATION = 0.004, 10.0  # [m], [s]: the paper's protocol, where no trajectory says otherwise


@dataclass(frozen=True)
class Design:
    """What the design of one model's palpation found."""

    name: str
    theta: Mapping[str, float]  # expected values
    units: tuple[str, ...]
    symbols: tuple[str, ...]
    duration: float  # [s]
    palpations: tuple[Palpation, ...]
    recommended: Palpation | None


def run_design(pipeline: Pipeline, name: str) -> Design:
    """Bounds for one model of a pipeline; raises ConfigurationError where something is not known that must be."""
    model, settings = pipeline.models[name], _within_safety(_timed(pipeline), pipeline)
    theta = _expected(model, name, settings, pipeline)
    depth, duration = _protocol(settings, pipeline)
    found = palpations(
        model,
        list(theta.values()),
        settings,
        pipeline.alignment.tip_mass or 0.0,
        depth,
        duration,
        sensing_of(settings, pipeline),
    )
    units = tuple(parameter.unit for parameter in model.parameters)
    symbols = tuple(parameter.symbol for parameter in model.parameters)
    return Design(name, theta, units, symbols, duration, tuple(found), best(found, theta))


def _timed(pipeline: Pipeline) -> DesignSettings:
    """The settings; a pipeline with a calibration knows its timing as well as that says."""
    settings = pipeline.tables.get("design", DesignSettings())
    assert isinstance(settings, DesignSettings)
    values = pipeline.calibration.values if pipeline.calibration else {}
    if settings.timing_std is None and "delay" in values and values["delay"].std > 0:
        return settings.model_copy(update={"timing_std": values["delay"].std})
    return settings


def _within_safety(settings: DesignSettings, pipeline: Pipeline) -> DesignSettings:
    """The settings with the robot's own limits, where the file has a [safety] table and they are tighter."""
    limits = pipeline.safety
    return settings if limits is None else settings.within(limits.motion, limits.stop_force)


def _expected(model: ContactModel, name: str, settings: DesignSettings, pipeline: Pipeline) -> dict[str, float]:
    truth = truth_of(pipeline.devices)
    theta = {}
    for parameter in model.parameters:
        given = settings.parameters.get(parameter.name, truth.get(parameter.name))
        if given is None:
            raise ConfigurationError(
                f"{pipeline.path}: the bounds depend on what is expected: set [design] parameters = "
                f'{{ {parameter.name} = "..." }} for [model.{name}]'
            )
        try:
            theta[parameter.name] = to_si(given, parameter.unit)
        except ValueError as error:
            raise ConfigurationError(f"{pipeline.path}: [design] parameters: {parameter.name}: {error}") from error
    return theta


def _protocol(settings: DesignSettings, pipeline: Pipeline) -> tuple[float, float]:
    """Mean depth [m] and length [s] of the measured part."""
    depth, duration = settings.depth, settings.duration
    if len(pipeline.trajectories) == 1 and (depth is None or duration is None):
        trajectory = next(iter(pipeline.trajectories.values()))
        step = 1e-3
        setpoint = setpoints_at(trajectory, np.arange(0.0, duration_of(trajectory), step))
        if setpoint.measuring.any():
            heights = setpoint.position[setpoint.measuring, 2]
            middle = -float(heights.max() + heights.min()) / 2
            duration = duration or float(np.count_nonzero(setpoint.measuring)) * step
            depth = depth or (middle if middle > 0 else None)
    return depth or _DEPTH, duration or _DURATION


def sensing_of(settings: DesignSettings, pipeline: Pipeline) -> MeasurementNoise:
    """What the pipeline measures with: noise of [design], else of its calibration, else the paper's; rates likewise."""
    values = pipeline.calibration.values if pipeline.calibration else {}

    def std(name: str) -> float:
        given = getattr(settings, name)
        return float(given if given is not None else values[name].value if name in values else _NOISE[name])

    def rate(role: str, given: float | None) -> float:
        return given or pipeline.ports[role].stream.rate or _RATE

    force, position = rate("force", settings.force_rate), rate("position", settings.position_rate)
    velocity = None
    if "velocity" in pipeline.ports.roles:
        velocity = QuantityNoise(rate("velocity", None), std("velocity_std"))
    live = is_live(pipeline.devices)
    in_step = not live and math.isclose(force / position, round(force / position), rel_tol=1e-9)
    return MeasurementNoise(
        QuantityNoise(force, std("force_std")), QuantityNoise(position, std("position_std")), velocity, in_step
    )
