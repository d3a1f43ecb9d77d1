"""The force in free air as a sign of that in contact: disturbances, a zero that has moved, and adhesion."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from palpate import Diagnosed, Flag, Floats, TrackEnd, TrackEvidence
from palpate_kit.budget.force_sensitivity import Along, along
from palpate_kit.budget.influence import effects_by_name
from palpate_kit.budget.systematic_terms import per_newton
from palpate_kit.numerics.normal_equations import linear_regression

from palpate_uncertainty.refit import sweeps
from palpate_uncertainty.refitted_model import standstill
from palpate_uncertainty.whiteness import oscillation
from palpate_uncertainty.zeroed_in_contact import zeroed_in_contact

# Choices.
_MIN_DEVIATIONS = 5.0  # standard deviations, from which on a force is not by chance
_MIN_SAMPLES = 100  # in free air
_BLOCK_SAMPLES = 20  # of the means that give the noise of a mean: it may be correlated over as many
_MIN_BLOCKS = 5  # of such means; of fewer the noise counts as white
_ADHESION_HEIGHT = 1e-3  # [m] above the surface, in which the material may still hold the tip
_MIN_HEIGHT_SHARE = 0.05  # of the way in contact: the same for the air before it
_DRAG_HEIGHT = 0.5e-3  # [m]: the same, where the force is compared with the speed
_MIN_CYCLES = 1.5  # of the motion's frequency in a standstill, to look for it there
_SPEED_SAMPLES = 10  # samples to either side, over which speed and acceleration are differences
_PULL_SAMPLES = 16  # samples of a mean, whose lowest is the pull

# Of a sphere that a material pulls with a force P, see `_adhesion_effects`.
_DEEPER_BY_ADHESION = 16.0 / 9.0  # squared additional depth over the depth, for P of the force (Johnson et al. 1971)
_CONSTANT_FORCE = 2.0 / 3.0  # of P, that acts deep in contact (Johnson et al. 1971)


@dataclass(frozen=True)
class _Air:
    """Samples without contact, of which the force should be the inertia of the tip and noise."""

    time: Floats  # (n,) [s]
    force: Floats  # (n,) [N]
    height: Floats  # (n,) [m]


def free_air(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the findings on every track of a point, with their effects on its values by the model's derivatives.

    A track's ending has its last samples (`tail`), those of them that the result is a mean of (`last`), and the
    parameters that are `held`; `by_motion` is a force that grows with speed or height in air: drag, a cable.
    """
    findings = {}
    for track in tracks:
        end = track.ending
        if end is None or sweeps(track) or not np.isfinite(track.values).all():
            continue
        sensitivity = along(track.model, end.tail, end.last, track.values, end.held)
        if sensitivity is None:
            continue
        by_motion = _MotionForce.of(track)
        flags = [*_hum_flags(track, sensitivity), *_moved_zero_flags(track, end, sensitivity)]
        if not _estimates_zero(track, end):
            flags += zeroed_in_contact(track, end)
        if not track.model.adhesive:  # what pulls the tip near the surface is the model's
            flags += _motion_flags(track, by_motion, sensitivity)
        flags += _adhesion_flags(track, by_motion, sensitivity)
        if flags:
            findings[track.name] = Diagnosed(tuple(flags), _joint_effects(flags))
    return findings


def _hum_flags(track: TrackEvidence, sensitivity: Along) -> Iterator[Flag]:
    """Yield a flag for a sine in the force at standstill of the frequency at which the tip then oscillates.

    It is hum, or an alias of it. The `motion` has frequency [Hz] and phases; `sensitivity` has the derivatives of the
    model's force in contact.
    """
    used = track.kept.used & np.isfinite(track.kept.position)
    motion = oscillation(track.kept.time[used], track.kept.position[used])
    standstill_force = standstill(track)
    is_finite = np.isfinite(standstill_force)
    force, time = standstill_force[is_finite], track.air_time[: len(is_finite)][is_finite]
    if motion is None or len(force) < _MIN_SAMPLES or motion[0] * (time[-1] - time[0]) < _MIN_CYCLES:
        return
    # Amplitude at standstill.
    frequency = motion[0]
    angle = 2.0 * np.pi * frequency * time
    weights, errors = _regression(np.column_stack([np.sin(angle), np.cos(angle)]), force)
    amplitude, error = float(np.hypot(*weights)), float(np.mean(errors))
    if amplitude < _MIN_DEVIATIONS * error:
        return
    # Its effect in contact, at any phase: the shifts that least squares answers to such an error of the force with.
    angle = 2.0 * np.pi * frequency * sensitivity.time
    in_phase = sensitivity.answer(amplitude * np.sin(angle))
    out_of_phase = sensitivity.answer(amplitude * np.cos(angle))
    shifts = None if in_phase is None or out_of_phase is None else np.hypot(in_phase, out_of_phase)
    effects = effects_by_name(track.model, shifts)
    size = f"{amplitude:.2g} +- {error:.1g} N"
    text = f"at standstill the force has a sine of {size} at {frequency:.3g} Hz, as the motion has"
    yield Flag("force-in-air", text, effects=effects)


@dataclass(frozen=True)
class _MotionForce:
    """A force that grows with the speed or the height of the tip in air: drag, a cable, a current that couples in."""

    weights: Floats  # (2,) [N s/m] with the speed and [N/m] with the height; 0 where it is not sure
    errors: Floats  # (2,)
    reference: float  # [m] height at which it is zero

    @classmethod
    def of(cls, track: TrackEvidence) -> _MotionForce:
        """Fit by least squares over the air before the first contact and after the last, each with its own zero.

        All weights are 0 where the air is too short, or its motion does not distinguish them.
        """
        # Before a touch is noticed the tip is in the material already.
        air_before = _Air(track.air_time, track.air_force, track.air_position)
        before = _above(track, air_before, _MIN_HEIGHT_SHARE * _largest_depth(track))
        after = _above(track, _Air(*track.air_after), _DRAG_HEIGHT)
        # Force without inertia, speed and height of each stretch of air that has samples.
        stretches = [_inertia_free(track, air) for air in (before, after)]
        stretches = [stretch for stretch in stretches if len(stretch[0])]
        # Weights with speed and height, their errors, and the reference height.
        no_force = cls(np.zeros(2), np.zeros(2), 0.0)
        if sum(len(force) for force, _, _ in stretches) < _MIN_SAMPLES:
            return no_force
        force, speed, height = (np.concatenate(columns) for columns in zip(*stretches, strict=True))
        # Columns of speed and height, and a zero of its own for the second stretch.
        number = np.concatenate([np.full(len(stretch[0]), float(i)) for i, stretch in enumerate(stretches)])
        reference = float(np.mean(height))
        own_zeros = [number == i for i in range(1, len(stretches))]
        columns = np.column_stack([speed, height - reference, *own_zeros])
        if np.linalg.matrix_rank(columns - columns.mean(axis=0)) < columns.shape[1]:
            return no_force
        weights, errors = (column[:2] for column in _regression(columns, force))
        return cls(np.where(np.abs(weights) > _MIN_DEVIATIONS * errors, weights, 0.0), errors, reference)


def _motion_flags(track: TrackEvidence, by_motion: _MotionForce, sensitivity: Along) -> Iterator[Flag]:
    """Yield a flag for a force that grows with speed or height in air, and so in contact."""
    units = ("the speed", "N s/m"), ("the height", "N/m")
    causes = [
        f"with {name} by {weight:+.2g} +- {error:.1g} {unit}"
        for (name, unit), weight, error in zip(units, by_motion.weights, by_motion.errors, strict=True)
        if weight
    ]
    if causes:
        height = track.surface - sensitivity.depth - by_motion.reference
        force = by_motion.weights[0] * -sensitivity.rate + by_motion.weights[1] * height
        text = f"in air the force changes {' and '.join(causes)}"
        yield Flag("force-in-air", text, effects=effects_by_name(track.model, sensitivity.answer(force)))


def _moved_zero_flags(track: TrackEvidence, end: TrackEnd, sensitivity: Along) -> Iterator[Flag]:
    """Yield a flag where the force after the contact differs from that before it: drift, or a tare in contact."""
    force, _, _ = _inertia_free(track, _above(track, _Air(*track.air_after)))
    if _estimates_zero(track, end) or len(force) < _MIN_SAMPLES:
        return
    tare = end.report.tare
    stated = tare.offset_std if tare is not None and tare.offset_std is not None else 0.0
    zero, error = float(np.mean(force)), float(np.hypot(_error_of_mean(force), stated))
    if abs(zero) < _MIN_DEVIATIONS * error:
        return
    shifts = per_newton(sensitivity)
    text = f"after the contact the force is {zero:+.2g} +- {error:.1g} N, where it should be none"
    yield Flag("force-in-air", text, effects=effects_by_name(track.model, None if shifts is None else zero * shifts))


def _estimates_zero(track: TrackEvidence, end: TrackEnd) -> bool:
    """Return True if the zero of the force is an unknown of the estimator."""
    if track.report is None:
        return "tare" in end.included
    return any(unknown.free and name == "bias" for name, unknown in track.report.unknowns.items())


def _adhesion_flags(track: TrackEvidence, by_motion: _MotionForce, sensitivity: Along) -> Iterator[Flag]:
    """Yield a flag for a pull on the way out, before the force is zero again; its effect is that of a sticky sphere.

    `by_motion` has the weights of a force in air with speed and height, of which that with the speed is subtracted.
    From the pull P = 1.5 pi w R follows the work of adhesion w, and from that the depth sqrt(2 pi w a/E*) by which a
    contact of radius a is less deep than one without adhesion (Johnson, Kendall and Roberts 1971).
    """
    if track.model.adhesive or track.model.memory:
        return
    after = _Air(*track.air_after)
    if len(after.time) < _MIN_SAMPLES:
        return
    force, speed, height = _inertia_free(track, after)
    force = force - by_motion.weights[0] * speed
    limit = track.surface + _ADHESION_HEIGHT
    near, free = force[height < limit], force[height > limit]
    if len(near) < _PULL_SAMPLES or len(free) < _MIN_SAMPLES:
        return
    weights = np.full(_PULL_SAMPLES, 1.0 / _PULL_SAMPLES)  # of a moving mean
    lowest = float(np.min(np.convolve(near, weights, "valid")))
    pull, error = float(np.mean(free)) - lowest, float(np.std(np.convolve(free, weights, "valid")))
    if pull < _MIN_DEVIATIONS * error:
        return
    effects = _adhesion_effects(track, sensitivity, pull)
    yield Flag("pull-off", f"the material pulls with {pull:.2g} +- {error:.1g} N on the way out", effects=effects)


def _adhesion_effects(track: TrackEvidence, sensitivity: Along, pull: float) -> dict[str, float] | None:
    """Return the shift of each parameter: by a constant force pi w R = 2 P/3 deep in contact, and a larger contact.

    At the same depth the contact of a sphere is as wide as one without adhesion that is deeper by
    sqrt(2 pi w a/E*), with w = P/(1.5 pi R), a = sqrt(R d) and F = 4/3 E* a d: sqrt(16/9 P d^2/F).
    """
    shifts = per_newton(sensitivity)
    elastic_count = sum(parameter.role == "elastic" for parameter in track.model.parameters)
    if shifts is None or elastic_count != 1:
        return None
    depth, force = float(np.mean(sensitivity.depth)), float(np.mean(sensitivity.force))
    if not (depth > 0 and force > 0):
        return None
    additional_depth = float(np.sqrt(_DEEPER_BY_ADHESION * pull / force)) * depth
    widening = 0.5 * additional_depth / depth  # of the contact's radius, which grows with the root of the depth
    effects = np.abs(_CONSTANT_FORCE * pull * shifts)
    for i, parameter in enumerate(track.model.parameters):
        if parameter.role == "viscous":
            effects[i] += widening * abs(track.values[i])
    return effects_by_name(track.model, effects)


def _largest_depth(track: TrackEvidence) -> float:
    """Return the largest depth [m] of the tip."""
    height = track.kept.position
    return max(track.surface - float(np.nanmin(height)), 0.0) if np.isfinite(height).any() else 0.0


def _above(track: TrackEvidence, air: _Air, distance: float = _ADHESION_HEIGHT) -> _Air:
    """Return the samples at more than a distance [m] above the surface, by default that in which a material holds."""
    is_above = air.height > track.surface + distance
    return _Air(air.time[is_above], air.force[is_above], air.height[is_above])


def _inertia_free(track: TrackEvidence, air: _Air) -> tuple[Floats, Floats, Floats]:
    """Return the force (n,) [N] less the inertia of the tip, speed (n,) [m/s] and height (n,) [m]."""
    n = _SPEED_SAMPLES
    if len(air.time) < 4 * n:  # two differences of 2 n samples each
        return np.zeros(0), np.zeros(0), np.zeros(0)
    speed = (air.height[2 * n :] - air.height[: -2 * n]) / (air.time[2 * n :] - air.time[: -2 * n])
    acceleration = (speed[2 * n :] - speed[: -2 * n]) / (air.time[3 * n : -n] - air.time[n : -3 * n])
    inner = slice(2 * n, -2 * n)
    force = air.force[inner] + (track.tip_mass or 0.0) * acceleration  # height and depth count in opposite directions
    finite = np.isfinite(force) & np.isfinite(speed[n:-n])
    return force[finite], speed[n:-n][finite], air.height[inner][finite]


def _regression(columns: Floats, force: Floats) -> tuple[Floats, Floats]:
    """Return the weights (m,) of columns (n, m) together with a constant, and their standard deviations.

    The noise is that of the means of blocks, so that it may be correlated from sample to sample.
    """
    regression = linear_regression(columns - columns.mean(axis=0), force - force.mean())
    noise = _error_of_mean(regression.residual) * math.sqrt(len(force))
    return regression.weights, regression.errors(noise)


def _error_of_mean(values: Floats) -> float:
    """Return the standard deviation of the mean of values (n,), by the scatter of the means of blocks."""
    count = max(len(values) // _BLOCK_SAMPLES, 1)
    if count < _MIN_BLOCKS:
        return float(np.std(values) / np.sqrt(max(len(values), 1)))
    means = values[: count * _BLOCK_SAMPLES].reshape(count, _BLOCK_SAMPLES).mean(axis=1)
    white = float(np.std(values) / np.sqrt(len(values)))
    return max(float(np.std(means, ddof=1) / np.sqrt(count)), white)


def _joint_effects(flags: Sequence[Flag]) -> dict[str, float]:
    """Return the standard uncertainty by parameter: the effects of all flags, which are independent."""
    terms: dict[str, float] = {}
    for flag in flags:
        for name, size in (flag.effects or {}).items():
            terms[name] = float(np.hypot(terms.get(name, 0.0), size))
    return terms
