"""The bias of a filter: what its own noise and its time step do to its estimates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import (
    Bias,
    Diagnosed,
    Flag,
    FlagMeaning,
    Floats,
    Layout,
    Samples,
    TrackEvidence,
)
from palpate_kit.kernel import Step, compile_step
from palpate_kit.numerics.tip_travel import noise_of, zero_phase_motion

from palpate_filters.covariance import congruence, mirror
from palpate_filters.inertial_filter import InertialFilter, PaperStart
from palpate_filters.kinematic_bias import kinematic_bias
from palpate_filters.kinematic_settings import KinematicSettings
from palpate_filters.process_models import InertialProcess
from palpate_filters.smoother import KinematicSmoother
from palpate_filters.smoother_bias import smoother_bias

_ENOUGH = 500  # samples
_MOST = 4096  # samples
_WARM = 0.25  # of them, which the errors take to become stationary
# Of the value, from which on the first order fails; of the bias, the standard uncertainty of the prediction. The second
# pair is of filters whose gain keeps fading: what their estimates' own scatter adds is not predicted.
_CONSTANT, _FADING = (0.35, 0.25), (0.08, 1.0)
_TELLING = 0.005  # of the value; less is not worth a word
_NOTHING, _KINEMATIC = 0.01, 0.1  # of the combined uncertainty; less is not a bias
_SHALLOWEST = 1e-5  # [m]
_FIRST = 1e-3  # [m] and [m/s], what the gains begin from


BIAS_FLAGS = {
    "noise-bias": FlagMeaning(
        "doubtful",
        "The noise in this filter's own state biases its estimates.",
        "Give the corrected value where there is one, or use a fit (inertial filters: or a kinematic one).",
    ),
}


@dataclass(frozen=True)
class _Noise:
    """Standard deviations of force [N] and velocity [m/s]."""

    force: float
    velocity: float


def noise_bias(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """The predicted bias of every track of a filter; see docs/uncertainty.md."""
    return {track.name: _said(track, bias) for track in tracks if (bias := _predicted(track)) is not None}


def _predicted(track: TrackEvidence) -> Floats | None:
    """Predicted bias (k,); None where the track has none, or where it cannot be determined."""
    if not isinstance(track.estimator, PaperStart | KinematicSettings) or not track.tip_mass:
        return None
    kinematic = isinstance(track.estimator, KinematicSettings)
    if kinematic and (track.estimator.follows_changes or track.model.memory or track.model.adhesive):
        return None
    kept = track.kept
    rows = np.flatnonzero(kept.used & np.isfinite(kept.position) & np.isfinite(kept.velocity))[-_MOST:]
    gaps = np.flatnonzero(np.diff(kept.index[rows]) != 1)
    rows = rows[gaps[-1] + 1 :] if len(gaps) else rows
    if len(rows) < _ENOUGH:
        return None
    return (_kinematic_along if kinematic else bias_along)(track, rows)


def _motion(track: TrackEvidence, rows: Any) -> Floats:
    """Depth, rate, acceleration and its jump, and the interval (n, 5), without noise as far as that can be had."""
    kept = track.kept
    time, position, velocity = kept.time[rows], kept.position[rows], kept.velocity[rows]
    interval = np.diff(time, append=2 * time[-1] - time[-2])
    always = np.ones(len(rows), bool)
    samples = Samples(
        np.rint(time * 1e9).astype(np.int64), time, interval, kept.force[rows], position, velocity, always, always
    )
    motion = zero_phase_motion(samples, None)
    jump = np.diff(motion.acceleration, append=motion.acceleration[-1])
    depth = np.maximum(track.surface - position, _SHALLOWEST)
    return np.column_stack([depth, motion.rate, motion.acceleration, jump, interval])


def _kinematic_along(track: TrackEvidence, rows: Any) -> Floats | None:
    """Predicted bias (k,) of a kinematic filter or smoother over consecutive rows of the kept samples."""
    kept, settings = track.kept, track.estimator
    assert isinstance(settings, KinematicSettings)
    assert track.tip_mass
    force, velocity = noise_of(kept.force[rows]), noise_of(kept.velocity[rows])
    real = np.array([force, noise_of(kept.position[rows]), velocity])
    given = settings.noise == "given"
    believed = [
        settings.force_std if given else force,
        settings.position_std,
        settings.velocity_std if given else velocity,
    ]
    numbers, motion = np.array([*believed, settings.jerk]), _motion(track, rows)
    if isinstance(settings, KinematicSmoother) and settings.relinearisations(track.model):
        return smoother_bias(track.model, track.tip_mass, track.values, motion, numbers, real)
    return kinematic_bias(track.model, track.tip_mass, track.values, motion, numbers, real, _WARM)


def bias_along(track: TrackEvidence, rows: Any) -> Floats | None:
    """Predicted bias (k,) over consecutive rows of the kept samples; None where the numbers do not hold."""
    kept, settings = track.kept, track.estimator
    assert isinstance(settings, PaperStart)
    assert track.tip_mass
    real = _Noise(noise_of(kept.force[rows]), noise_of(kept.velocity[rows]))
    given = not isinstance(settings, InertialFilter) or settings.noise == "given"
    believed = _Noise(settings.force_std, settings.velocity_std) if given else real
    process = InertialProcess(track.model, track.tip_mass)
    step, place = bias_step(process)
    numbers = np.array([*track.values, believed.force, believed.velocity, real.force, real.velocity])
    state = np.zeros(step.state.numel())
    nx = 2 + len(track.model.memory)
    state[: nx * nx] = (_FIRST**2 * np.eye(nx)).ravel()
    _, outputs = compile_step(step).run(state, _motion(track, rows), numbers)
    late = outputs[int(_WARM * len(rows)) :]
    k = len(track.values)
    information = late[:, place["information"]].sum(axis=0).reshape(k, k)
    scale = np.sqrt(np.diag(information))
    if not np.isfinite(late).all() or not (scale > 0).all():
        return None
    unit = information / np.outer(scale, scale)
    return np.asarray(np.linalg.solve(unit, late[:, place["pull"]].sum(axis=0) / scale) / scale)


def bias_step(process: InertialProcess) -> tuple[Step, Layout]:
    """One sample of the filter's error statistics along a known motion, and how its output is laid out.

    A recursive filter on x' = f(x, theta, u) settles where sum psi nu / S = 0, nu its innovations, S their variance
    and psi = dx/dtheta of its prediction of the rate (Ljung 1979). The sensor's noise n is in u, but not in the motion,
    so that the filter's error e is in nu and, through f_theta(x + e), in psi as well. To second order in e

        sum psi psi^T / S  bias = -sum (E[psi~ e] + psi E[e]) / S,      psi~ the part of psi that e makes,

    where E[e e^T], E[psi~ e^T] and E[e] follow from the filter's own gain K by e' = f_x (1 - K h^T) e + B n + f_x K w,
    psi~' = f_x psi~ + d(f_x psi + f_theta)/dx e. E[e] has the curvature of f, and that within one step the
    acceleration is taken as constant.

    Filter state: gain covariance (nx nx), the joint covariance of e and psi~, psi (nx k), E[e], the model's memory.
    Sample: depth [m], rate [m/s], acceleration and its jump to the next sample [m/s^2], interval to it [s]. Settings:
    theta (k), sigma_u and sigma_vel that the filter assumes, and the real ones.
    """
    import casadi as ca

    k, r = len(process.model.parameters), len(process.model.memory)
    nx, m = 2 + r, (2 + r) * (1 + k)
    P, C, psi = ca.SX.sym("P", nx, nx), ca.SX.sym("C", m, m), ca.SX.sym("psi", nx, k)
    mean, memory, sample, numbers = (ca.SX.sym(*s) for s in (("e", nx), ("m", r), ("w", 5), ("p", k + 4)))
    depth, rate, acceleration, jump, interval = ca.vertsplit(sample)
    theta, believed, real = numbers[:k], numbers[k : k + 2], numbers[k + 2 :]

    x, t, push = ca.SX.sym("x", nx), ca.SX.sym("t", k), ca.SX.sym("u")
    ahead = ca.vertcat(*process.predict(ca.vertsplit(ca.vertcat(x, t)), push, interval)[:nx])
    f_x, f_t = ca.jacobian(ahead, x), ca.jacobian(ahead, t)
    slopes = ca.SX.sym("s", nx, k)
    moved = ca.vec(f_x @ slopes + f_t)
    bent = ca.vertcat(*[0.5 * ca.trace(ca.hessian(ahead[i], x)[0] @ C[:nx, :nx]) for i in range(nx)])
    found = [f_x, f_t, ca.jacobian(moved, x), bent, ahead]

    S = P[1, 1] + believed[1] ** 2
    K = P[:, 1] / S
    kept = ca.SX.eye(nx)
    kept[:, 1] -= K
    every = ca.kron(ca.SX.eye(1 + k), kept)
    C_after, psi_after, mean_after = congruence(every, C), kept @ psi, kept @ mean
    C_after[:nx, :nx] += K @ K.T * real[1] ** 2
    P_after = mirror(congruence(kept, P) + K @ K.T * believed[1] ** 2)
    here = ca.vertcat(depth, rate, memory)
    felt = process.force(ca.vertsplit(ca.vertcat(here, theta))) + process.mass * acceleration
    A, F_t, drive, curve, following = ca.substitute(found, [x, t, slopes, push], [here, theta, psi_after, felt])
    curve = ca.substitute([curve], [C], [C_after])[0]
    to_depth, to_rate = process.gain(interval)
    B = ca.vertcat(to_depth, to_rate, *[0.0] * r)
    defect = ca.vertcat(interval**2 / 6 * jump, interval / 2 * jump, *[0.0] * r)
    whole = ca.kron(ca.SX.eye(1 + k), A)
    whole[nx:, :nx] = drive
    C_next = congruence(whole, C_after)
    C_next[:nx, :nx] += B @ B.T * real[0] ** 2
    P_next = congruence(A, P_after) + B @ B.T * believed[0] ** 2

    seen, pulled = psi[1, :].T, ca.vertcat(*[C[1, nx * (1 + i) + 1] for i in range(k)])
    return Step(
        state=ca.vertcat(ca.vec(P), ca.vec(C), ca.vec(psi), mean, memory),
        sample=sample,
        settings=numbers,
        next_state=ca.vertcat(
            ca.vec(P_next), ca.vec(C_next), ca.vec(A @ psi_after + F_t), A @ mean_after + curve - defect, following[2:]
        ),
        output=ca.vertcat(ca.vec(seen @ seen.T) / S, -(pulled + seen * mean[1]) / S),
    ), Layout(information=k * k, pull=k)


def _said(track: TrackEvidence, bias: Floats) -> Diagnosed:
    """Flags, biases and a table."""
    limit, trust = _FADING if track.estimator.follows_changes else _CONSTANT
    nothing = _KINEMATIC if isinstance(track.estimator, KinematicSettings) else _NOTHING
    biases, effects, small, large = {}, dict[str, float](), [], []
    for parameter, value, shift, combined in zip(
        track.model.parameters, track.values.tolist(), bias.tolist(), track.combined.tolist(), strict=True
    ):
        if abs(shift) < nothing * combined:
            continue
        std = trust * abs(shift) if abs(shift) <= limit * abs(value) else None
        biases[parameter.name] = Bias(shift, std)
        effects[parameter.name] = abs(shift)
        share = f"{parameter.name} by {100 * shift / abs(value or 1.0):+.2g} %"
        if std is None:
            large.append(share)
        elif abs(shift) > max(_TELLING * abs(value), 0.25 * combined):
            # Its uncertainty is that of all judges together, some of whom have not spoken yet.
            small.append(f"{share}; corrected: {value - shift:.4g} {parameter.unit} (see its budget)")
    texts = [f"the filter's own noise and time step shift {', '.join(small)}"] if small else []
    texts += [f"the filter's own noise shifts {', '.join(large)}: too far to be corrected"] if large else []
    flags = (Flag("noise-bias", "; ".join(texts), effects=effects),) if texts else ()
    return Diagnosed(flags, biases=biases)
