"""The bias of a filter by its own noise and its time step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Bias, Diagnosed, Flag, Floats, Layout, Samples, TrackEvidence
from palpate_kit.kernel import Step, compile_step
from palpate_kit.numerics.tip_travel import noise_of, zero_phase_motion
from palpate_kit.terminal.quantities import number_with_unit

from palpate_filters.covariance import congruence, mirror
from palpate_filters.inertial_filter import InertialFilter, PaperStart
from palpate_filters.kinematic_bias import ErrorStatistics, kinematic_bias
from palpate_filters.kinematic_settings import KinematicSettings
from palpate_filters.process_models import InertialProcess
from palpate_filters.smoother import KinematicSmoother
from palpate_filters.smoother_bias import smoother_bias

_MIN_SAMPLES = 500  # a choice: one second at 500 Hz; a shorter stretch has no prediction
_MAX_SAMPLES = 4096  # of the end of a track, a choice (0120): the prediction costs 0.1 s
_TRANSIENT_SHARE = 0.25  # of the samples, a choice: the filter's errors become stationary within them
_MIN_DEPTH = 1e-5  # [m], a choice: slopes are taken no nearer to the pole of sqrt(d)
_SAMPLE_ENTRIES = 5  # depth, rate, acceleration, its jump, interval
_SHOWN_DIGITS = 4  # of a corrected value, a choice
_START_STD = 1e-3  # [m] and [m/s], a choice: the gains start from it and forget it within the transient


@dataclass(frozen=True)
class _Trust:
    """Limits of the prediction for one kind of filter."""

    max_share: float  # of the value: beyond a bias of this share the first order fails, and nothing is corrected
    relative_std: float  # standard uncertainty of the prediction, of the bias


# Both measured on simulated records (0120). The scatter that fading adds to its estimates is not predicted.
_TRUST = _Trust(max_share=0.35, relative_std=0.25)
_TRUST_WITH_FADING = _Trust(max_share=0.08, relative_std=1.0)
_MIN_REPORTED_SHARE = 0.005  # of the value, a choice: less has no sentence
_MIN_REPORTED_UNCERTAINTY = 0.25  # of the combined uncertainty, a choice: less has no sentence
_MIN_BIAS = 0.01  # of the combined uncertainty, a choice: a smaller shift does not count
_MIN_KINEMATIC_BIAS = 0.1  # the same of kinematic filters, a choice (0150)


@dataclass(frozen=True)
class _Noise:
    """Standard deviations of force [N] and velocity [m/s]."""

    force: float
    velocity: float


def noise_bias(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the predicted bias of every track of a filter; see docs/uncertainty.md."""
    return {track.name: _diagnosis(track, bias) for track in tracks if (bias := _predict_bias(track)) is not None}


def _predict_bias(track: TrackEvidence) -> Floats | None:
    """Return the predicted bias (k,); None where the track has none, or where it cannot be determined.

    It has none without a filter or a tip's mass. Of a kinematic filter it is not known where the parameters may change,
    or where the model has internal states or adhesion.
    """
    if not isinstance(track.estimator, PaperStart | KinematicSettings) or not track.tip_mass:
        return None
    is_kinematic = isinstance(track.estimator, KinematicSettings)
    if is_kinematic and (track.estimator.follows_changes or track.model.memory or track.model.adhesive):
        return None
    # The last samples without a gap that have position and velocity.
    kept = track.kept
    rows = np.flatnonzero(kept.used & np.isfinite(kept.position) & np.isfinite(kept.velocity))[-_MAX_SAMPLES:]
    gaps = np.flatnonzero(np.diff(kept.index[rows]) != 1)
    if len(gaps):
        rows = rows[gaps[-1] + 1 :]
    if len(rows) < _MIN_SAMPLES:
        return None
    return _kinematic_bias_along(track, rows) if is_kinematic else bias_along(track, rows)


def _motion(track: TrackEvidence, rows: Any) -> Floats:
    """Return the motion (n, 5) at some rows of a track's kept samples, smoothed without a delay.

    Columns: depth [m], rate [m/s], acceleration and its jump to the next sample [m/s^2], interval to that sample [s];
    the last interval is that before it.
    """
    kept = track.kept
    time, position, velocity = kept.time[rows], kept.position[rows], kept.velocity[rows]
    interval = np.diff(time, append=2 * time[-1] - time[-2])
    active = np.ones(len(rows), bool)
    stamps = np.rint(time * 1e9).astype(np.int64)  # [ns]
    samples = Samples(
        stamp=stamps,
        time=time,
        interval=interval,
        force=kept.force[rows],
        position=position,
        velocity=velocity,
        contact=active,
        active=active,
    )
    motion = zero_phase_motion(samples, None)
    jump = np.diff(motion.acceleration, append=motion.acceleration[-1])
    depth = np.maximum(track.surface - position, _MIN_DEPTH)
    return np.column_stack([depth, motion.rate, motion.acceleration, jump, interval])


def _kinematic_bias_along(track: TrackEvidence, rows: Any) -> Floats | None:
    """Return the predicted bias (k,) of a kinematic filter or smoother over consecutive rows of the kept samples.

    It follows from the motion (depth, rate, acceleration) and from standard deviations: the `real` ones of force [N],
    position [m] and velocity [m/s], and those that the filter has `assumed`, with its jerk.
    """
    kept, settings = track.kept, track.estimator
    assert isinstance(settings, KinematicSettings)
    assert track.tip_mass
    force_noise, velocity_noise = noise_of(kept.force[rows]), noise_of(kept.velocity[rows])
    real = np.array([force_noise, noise_of(kept.position[rows]), velocity_noise])
    # The filter's own belief: stated in its settings, or measured before the contact.
    assumed_force, assumed_velocity = settings.declared_noise or (force_noise, velocity_noise)
    assumed = np.array([assumed_force, settings.position_std, assumed_velocity, settings.jerk])
    motion = _motion(track, rows)
    if isinstance(settings, KinematicSmoother) and settings.relinearisations(track.model):
        return smoother_bias(track.model, track.tip_mass, track.values, motion, assumed, real)
    return kinematic_bias(
        track.model, track.tip_mass, track.values, inputs=motion, assumed=assumed, real=real, transient=_TRANSIENT_SHARE
    )


def bias_along(track: TrackEvidence, rows: Any) -> Floats | None:
    """Return the predicted bias (k,) over consecutive rows of the kept samples; None where the numbers do not hold."""
    kept, settings = track.kept, track.estimator
    assert isinstance(settings, PaperStart)
    assert track.tip_mass
    real = _Noise(noise_of(kept.force[rows]), noise_of(kept.velocity[rows]))
    is_stated = not isinstance(settings, InertialFilter) or settings.noise == "given"
    assumed = _Noise(settings.force_std, settings.velocity_std) if is_stated else real

    # The error statistics along the motion, from an uncertain start.
    step, layout = bias_step(InertialProcess(track.model, track.tip_mass))
    numbers = np.array([*track.values, assumed.force, assumed.velocity, real.force, real.velocity])
    state = np.zeros(step.state.numel())
    nx = 2 + len(track.model.memory)
    state[: nx * nx] = (_START_STD**2 * np.eye(nx)).ravel()
    _, outputs = compile_step(step, is_brief=True).run(state, _motion(track, rows), numbers)

    # The bias is information^-1 pull, each parameter in the unit in which its information is 1.
    stationary = outputs[int(_TRANSIENT_SHARE * len(rows)) :]
    k = len(track.values)
    information = stationary[:, layout["information"]].sum(axis=0).reshape(k, k)
    scale = np.sqrt(np.diag(information))
    if not np.isfinite(stationary).all() or not (scale > 0).all():
        return None
    unit = information / np.outer(scale, scale)
    return np.asarray(np.linalg.solve(unit, stationary[:, layout["pull"]].sum(axis=0) / scale) / scale)


def bias_step(process: InertialProcess) -> tuple[Step, Layout]:
    """Return one sample of the filter's error statistics along a known motion, and the layout of its output.

    A recursive filter on x' = f(x, theta, u) settles where sum psi nu / S = 0, nu its innovations, S their variance
    and psi = dx/dtheta of its prediction of the rate (Ljung 1979). The sensor's noise n is in u, but not in the motion,
    so that the filter's error e is in nu and, through f_theta(x + e), in psi as well. To second order in e

        sum psi psi^T / S  bias = -sum (E[psi~ e] + psi E[e]) / S,      psi~ the part of psi that e makes,

    where E[e e^T], E[psi~ e^T] and E[e] follow from the filter's own gain K by e' = f_x (1 - K h^T) e + B n + f_x K w,
    psi~' = f_x psi~ + d(f_x psi + f_theta)/dx e. E[e] has the curvature of f, and the error of an acceleration that is
    taken as constant within one step.

    Filter state: gain covariance (nx nx), the joint covariance of e and psi~, psi (nx k), E[e], the model's memory.
    Sample: depth [m], rate [m/s], acceleration and its jump to the next sample [m/s^2], interval to it [s]. Settings:
    theta (k), sigma_u and sigma_vel that the filter assumes, and the real ones.
    """
    import casadi as ca

    # Symbols of the state, of a sample and of the settings; the filter's own state is depth, rate and memory.
    k, r = len(process.model.parameters), len(process.model.memory)
    nx, m = 2 + r, (2 + r) * (1 + k)
    P, C, psi = ca.SX.sym("P", nx, nx), ca.SX.sym("C", m, m), ca.SX.sym("psi", nx, k)
    mean, memory = ca.SX.sym("e", nx), ca.SX.sym("m", r)
    sample, numbers = ca.SX.sym("w", _SAMPLE_ENTRIES), ca.SX.sym("p", k + 4)  # theta, two noises twice
    theta, assumed, real = numbers[:k], numbers[k : k + 2], numbers[k + 2 :]

    # Update with the measured rate, then predict by the measured force.
    before = ErrorStatistics(P, C, psi, mean)
    updated = _update(before, assumed_std=assumed[1], real_std=real[1])
    after, next_memory = _predict(
        process, before=updated, sample=sample, theta=theta, memory=memory, force_std=(assumed[0], real[0])
    )

    # Both sums of the bias, for the rate alone is measured.
    S = P[1, 1] + assumed[1] ** 2
    psi_rate = psi[1, :].T
    # E[psi~ e] of the rate, row 1 of every block of nx: C has e first, then psi~ of each parameter.
    coupling = ca.vertcat(*[C[1, nx * (1 + i) + 1] for i in range(k)])
    return Step(
        state=ca.vertcat(ca.vec(P), ca.vec(C), ca.vec(psi), mean, memory),
        sample=sample,
        settings=numbers,
        next_state=ca.vertcat(ca.vec(after.P), ca.vec(after.C), ca.vec(after.psi), after.mean, next_memory),
        output=ca.vertcat(ca.vec(psi_rate @ psi_rate.T) / S, -(coupling + psi_rate * mean[1]) / S),
    ), Layout(information=k * k, pull=k)


def _update(before: ErrorStatistics, assumed_std: Any, real_std: Any) -> ErrorStatistics:
    """Return the statistics after a measured rate [m/s]: its gain follows from the assumed noise."""
    import casadi as ca

    nx, k = before.psi.shape
    S = before.P[1, 1] + assumed_std**2
    K = before.P[:, 1] / S
    reduction = ca.SX.eye(nx)  # 1 - K h^T
    reduction[:, 1] -= K
    C = congruence(ca.kron(ca.SX.eye(1 + k), reduction), before.C)
    C[:nx, :nx] += K @ K.T * real_std**2
    P = mirror(congruence(reduction, before.P) + K @ K.T * assumed_std**2)
    return ErrorStatistics(P, C, reduction @ before.psi, reduction @ before.mean)


def _predict(
    process: InertialProcess, before: ErrorStatistics, sample: Any, theta: Any, memory: Any, force_std: tuple[Any, Any]
) -> tuple[ErrorStatistics, Any]:
    """Return the statistics and the model's memory at the next sample, along the motion.

    The statistics are the gain covariance P, the joint covariance C of e and psi~, psi, and the mean E[e]. `force_std`
    is the noise [N] of the force, assumed and real.
    """
    import casadi as ca

    # The process and its slopes at the sample's motion, with the force that makes its acceleration.
    nx, k = before.psi.shape
    depth, rate, acceleration, jump, interval = ca.vertsplit(sample)
    state = ca.vertcat(depth, rate, memory, theta)
    force = process.force(ca.vertsplit(state)) + process.mass * acceleration
    slopes = _process_slopes(process, state, force, interval, before.psi, error_covariance=before.C[:nx, :nx])
    no_memory = [0.0] * (nx - 2)
    B = ca.vertcat(*process.gain(interval), *no_memory)
    defect = ca.vertcat(interval**2 / 6 * jump, interval / 2 * jump, *no_memory)  # of a constant acceleration

    # psi~' = f_x psi~ + d(f_x psi + f_theta)/dx e.
    joint = ca.kron(ca.SX.eye(1 + k), slopes.by_state)
    joint[nx:, :nx] = slopes.mixed
    C = congruence(joint, before.C)
    assumed_std, real_std = force_std
    C[:nx, :nx] += B @ B.T * real_std**2
    # P' = f_x P f_x^T + B B^T sigma^2, psi' = f_x psi + f_theta, and E[e] with the curvature.
    P = congruence(slopes.by_state, before.P) + B @ B.T * assumed_std**2
    psi = slopes.by_state @ before.psi + slopes.by_theta
    mean = slopes.by_state @ before.mean + slopes.curvature - defect
    return ErrorStatistics(P, C, psi, mean), slopes.next_state[2:]


@dataclass(frozen=True)
class _ProcessSlopes:
    """Derivatives of one step f of the process at a state."""

    by_state: Any  # f_x (nx, nx)
    by_theta: Any  # f_theta (nx, k)
    mixed: Any  # d(f_x psi + f_theta)/dx (nx k, nx)
    curvature: Any  # tr(f_xx E[e e^T])/2 (nx,)
    next_state: Any  # f (nx,)


def _process_slopes(
    process: InertialProcess, state: Any, force: Any, interval: Any, psi: Any, error_covariance: Any
) -> _ProcessSlopes:
    """Return the derivatives of a step at a state (nx + k,) and force, for slopes psi (nx, k) and E[e e^T] (nx, nx)."""
    import casadi as ca

    # Symbols of the state, the parameters, the force, psi and E[e e^T], for which the values are put in at the end.
    nx, k = psi.shape
    x, t, u = ca.SX.sym("x", nx), ca.SX.sym("t", k), ca.SX.sym("u")
    slopes, covariance = ca.SX.sym("s", nx, k), ca.SX.sym("E", nx, nx)
    step = ca.vertcat(*process.predict(ca.vertsplit(ca.vertcat(x, t)), u, interval)[:nx])
    by_state, by_theta = ca.jacobian(step, x), ca.jacobian(step, t)
    mixed = ca.jacobian(ca.vec(by_state @ slopes + by_theta), x)
    curvature = ca.vertcat(*[0.5 * ca.trace(ca.hessian(step[i], x)[0] @ covariance) for i in range(nx)])
    expressions = [by_state, by_theta, mixed, curvature, step]
    values = [state[:nx], state[nx:], psi, force, error_covariance]
    return _ProcessSlopes(*ca.substitute(expressions, [x, t, slopes, u, covariance], values))


def _diagnosis(track: TrackEvidence, bias: Floats) -> Diagnosed:
    """Return the biases of a track's parameters, and a flag with those that are worth a sentence.

    `bias` (k,) is the predicted one. A bias below a share of the combined standard uncertainty does not count.
    """
    trust = _TRUST_WITH_FADING if track.estimator.follows_changes else _TRUST
    min_bias = _MIN_KINEMATIC_BIAS if isinstance(track.estimator, KinematicSettings) else _MIN_BIAS
    biases, effects, corrected, uncorrected = {}, dict[str, float](), list[str](), list[str]()
    for parameter, value, shift, combined in zip(
        track.model.parameters, track.values.tolist(), bias.tolist(), track.combined.tolist(), strict=True
    ):
        if abs(shift) < min_bias * combined:
            continue
        # A small bias is corrected, with an uncertainty that is a share of it.
        is_small = abs(shift) <= trust.max_share * abs(value)
        biases[parameter.name] = Bias(shift, trust.relative_std * abs(shift) if is_small else None)
        effects[parameter.name] = abs(shift)
        share = f"{parameter.name} by {100 * shift / abs(value or 1.0):+.2g} %"
        if not is_small:
            uncorrected.append(share)
        elif abs(shift) > max(_MIN_REPORTED_SHARE * abs(value), _MIN_REPORTED_UNCERTAINTY * combined):
            # No uncertainty here: that of all diagnoses together is not yet known.
            corrected_value = number_with_unit(value - shift, parameter.unit, _SHOWN_DIGITS)
            corrected.append(f"{share}; corrected: {corrected_value} (see its budget)")
    text = _bias_text(corrected, uncorrected)
    flags = (Flag("noise-bias", text, effects=effects),) if text else ()
    return Diagnosed(flags, biases=biases)


def _bias_text(corrected: list[str], uncorrected: list[str]) -> str:
    """Return the sentence on the biases that are corrected, and on those that are too far; empty without any."""
    texts = []
    if corrected:
        texts.append(f"the filter's own noise and time step shift {', '.join(corrected)}")
    if uncorrected:
        texts.append(f"the filter's own noise shifts {', '.join(uncorrected)}: too far to be corrected")
    return "; ".join(texts)
