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

_MIN_DEVIATIONS = 5.0  # standard deviations
_MIN_SAMPLES = 100  # in free air
_BLOCK_SAMPLES = 20  # samples that the noise of a mean is found over, so that it may hang together for as long
_ADHESION_HEIGHT = 1e-3  # [m] above the surface, in which the material may still hold the tip
_MIN_HEIGHT_SHARE = 0.05  # of the way in contact, the same of the air before it
_DRAG_HEIGHT = 0.5e-3  # [m] the same, where the force is compared with the speed
_MIN_CYCLES = 1.5  # of the motion's frequency in a standstill, to look for it there
_SPEED_SAMPLES = 10  # samples to either side, over which the speed is found
_PULL_SAMPLES = 16  # samples of a mean


@dataclass(frozen=True)
class _Air:
    """Samples without contact, of which the force should be the inertia of the tip and noise."""

    time: Floats  # (n,) [s]
    force: Floats  # (n,) [N]
    height: Floats  # (n,) [m]


def free_air(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Findings on every track of a point, each with what it does to the track's values by the model's derivatives."""
    found = {}
    for track in tracks:
        end = track.ending
        if end is None or sweeps(track) or not np.isfinite(track.values).all():
            continue
        course = along(track.model, end.tail, end.last, track.values, end.held)
        if course is not None:
            by_motion = _Motion.of(track)
            flags = (*_tone(track, course), *_moved_zero(track, end, course))
            if not _estimates_zero(track, end):
                flags = (*flags, *zeroed_in_contact(track, end))
            if not track.model.adhesive:  # what pulls the tip near the surface is the model's
                flags = (*flags, *_with_motion(track, by_motion, course))
            flags = (*flags, *_adhesion(track, by_motion, course))
            if flags:
                found[track.name] = Diagnosed(flags, _together(flags))
    return found


def _tone(track: TrackEvidence, course: Along) -> Iterator[Flag]:
    """Yield a sine in the force at standstill of the frequency at which the tip then oscillates: hum, or an alias of
    it."""
    used = track.kept.used & np.isfinite(track.kept.position)
    rhythm = oscillation(track.kept.time[used], track.kept.position[used])
    force = standstill(track)
    time = track.air_time[: len(force)]
    known = np.isfinite(force)
    force, time = force[known], time[known]
    if rhythm is None or len(force) < _MIN_SAMPLES or rhythm[0] * (time[-1] - time[0]) < _MIN_CYCLES:
        return
    angle = 2.0 * np.pi * rhythm[0] * time
    weights, errors = _regression(np.column_stack([np.sin(angle), np.cos(angle)]), force)
    size, error = float(np.hypot(*weights)), float(np.mean(errors))
    if size < _MIN_DEVIATIONS * error:
        return
    angle = 2.0 * np.pi * rhythm[0] * course.time
    parts = [course.answer(size * wave) for wave in (np.sin(angle), np.cos(angle))]
    effects = effects_by_name(
        track.model, np.hypot(parts[0], parts[1]) if parts[0] is not None and parts[1] is not None else None
    )
    text = f"at standstill the force has a sine of {size:.2g} +- {error:.1g} N at {rhythm[0]:.3g} Hz, as the motion has"
    yield Flag("force-in-air", text, effects=effects)


@dataclass(frozen=True)
class _Motion:
    """A force that grows with the speed or the height of the tip in air: drag, a cable, a current that couples in."""

    weights: Floats  # (2,) [N s/m] with the speed and [N/m] with the height; 0 where it is not sure
    errors: Floats  # (2,)
    reference: float  # [m] height at which it is zero

    @classmethod
    def of(cls, track: TrackEvidence) -> _Motion:
        """By least squares over the air before the first contact and after the last, each with its own zero."""
        # Before a touch is noticed the tip is in the material already.
        before = _far(track, _Air(track.air_time, track.air_force, track.air_position), _MIN_HEIGHT_SHARE * _way(track))
        parts = (before, _far(track, _Air(*track.air_after), _DRAG_HEIGHT))
        air = [inner for part in parts if len((inner := _inertia_free(track, part))[0])]
        nothing = cls(np.zeros(2), np.zeros(2), 0.0)
        if sum(len(force) for force, _, _ in air) < _MIN_SAMPLES:
            return nothing
        force, speed, height = (np.concatenate([part[i] for part in air]) for i in range(3))
        stretch = np.concatenate([np.full(len(part[0]), float(i)) for i, part in enumerate(air)])
        reference = float(np.mean(height))
        columns = np.column_stack([speed, height - reference, *(stretch == i for i in range(1, len(air)))])
        if np.linalg.matrix_rank(columns - columns.mean(axis=0)) < columns.shape[1]:
            return nothing
        weights, errors = (column[:2] for column in _regression(columns, force))
        return cls(np.where(np.abs(weights) > _MIN_DEVIATIONS * errors, weights, 0.0), errors, reference)


def _with_motion(track: TrackEvidence, found: _Motion, course: Along) -> Iterator[Flag]:
    """Errors that grow with speed or height in air do so in contact."""
    units = ("the speed", "N s/m"), ("the height", "N/m")
    said = [
        f"with {name} by {weight:+.2g} +- {error:.1g} {unit}"
        for (name, unit), weight, error in zip(units, found.weights, found.errors, strict=True)
        if weight
    ]
    if said:
        height = track.surface - course.depth - found.reference
        error = found.weights[0] * -course.rate + found.weights[1] * height
        text = f"in air the force changes {' and '.join(said)}"
        yield Flag("force-in-air", text, effects=effects_by_name(track.model, course.answer(error)))


def _moved_zero(track: TrackEvidence, end: TrackEnd, course: Along) -> Iterator[Flag]:
    """Yield a force after the contact that is not the one before it: by drift, or a tare that was taken in contact."""
    force, _, _ = _inertia_free(track, _far(track, _Air(*track.air_after)))
    if _estimates_zero(track, end) or len(force) < _MIN_SAMPLES:
        return
    tare = end.report.tare
    stated = tare.offset_std if tare is not None and tare.offset_std is not None else 0.0
    zero, error = float(np.mean(force)), float(np.hypot(_error_of_mean(force), stated))
    if abs(zero) < _MIN_DEVIATIONS * error:
        return
    shifts = per_newton(course)
    text = f"after the contact the force is {zero:+.2g} +- {error:.1g} N, where it should be none"
    yield Flag("force-in-air", text, effects=effects_by_name(track.model, None if shifts is None else zero * shifts))


def _estimates_zero(track: TrackEvidence, end: TrackEnd) -> bool:
    """True where the zero of the force is an unknown of the estimator."""
    if track.report is None:
        return "tare" in end.included
    return any(unknown.free and name == "bias" for name, unknown in track.report.unknowns.items())


def _adhesion(track: TrackEvidence, by_motion: _Motion, course: Along) -> Iterator[Flag]:
    """Yield a pull on the way out, before the force is zero again, and what it does as that of a sphere that sticks.

    From the pull P = 1.5 pi w R follows the work of adhesion w, and from that by how much more the tip is within the
    material, sqrt(2 pi w a/E*), than a contact of radius a without adhesion (Johnson, Kendall and Roberts 1971).
    """
    if track.model.adhesive or track.model.memory:
        return
    after = _Air(*track.air_after)
    if len(after.time) < _MIN_SAMPLES:
        return
    force, speed, height = _inertia_free(track, after)
    force = force - by_motion.weights[0] * speed
    near, rest = force[height < track.surface + _ADHESION_HEIGHT], force[height > track.surface + _ADHESION_HEIGHT]
    if len(near) < _PULL_SAMPLES or len(rest) < _MIN_SAMPLES:
        return
    mean = np.full(_PULL_SAMPLES, 1.0 / _PULL_SAMPLES)
    lowest = float(np.min(np.convolve(near, mean, "valid")))
    pull, error = float(np.mean(rest)) - lowest, float(np.std(np.convolve(rest, mean, "valid")))
    if pull < _MIN_DEVIATIONS * error:
        return
    effects = _by_adhesion(track, course, pull)
    yield Flag("pull-off", f"the material pulls with {pull:.2g} +- {error:.1g} N on the way out", effects=effects)


def _by_adhesion(track: TrackEvidence, course: Along, pull: float) -> dict[str, float] | None:
    """Shift of each parameter: of a constant force pi w R = 2 P/3 deep in the contact, and of a larger contact.

    At the same depth the contact of a sphere is as wide as one without adhesion that is deeper by
    sqrt(2 pi w a/E*), with w = P/(1.5 pi R), a = sqrt(R d) and F = 4/3 E* a d: sqrt(16/9 P d^2/F).
    """
    shifts = per_newton(course)
    elastic = [i for i, p in enumerate(track.model.parameters) if p.role == "elastic"]
    if shifts is None or len(elastic) != 1:
        return None
    depth, force = float(np.mean(course.depth)), float(np.mean(course.force))
    if not (depth > 0 and force > 0):
        return None
    deeper = float(np.sqrt(16.0 / 9.0 * pull / force)) * depth
    wider = 0.5 * deeper / depth  # of the contact's radius, as that grows with the root of the depth
    moved = np.abs(2.0 / 3.0 * pull * shifts)
    for i, parameter in enumerate(track.model.parameters):
        if parameter.role == "viscous":
            moved[i] += wider * abs(track.values[i])
    return effects_by_name(track.model, moved)


def _way(track: TrackEvidence) -> float:
    """Largest depth [m] of the tip."""
    place = track.kept.position
    return max(track.surface - float(np.nanmin(place)), 0.0) if np.isfinite(place).any() else 0.0


def _far(track: TrackEvidence, air: _Air, above: float = _ADHESION_HEIGHT) -> _Air:
    """Return the part that is further above the surface than a material sticks."""
    far = air.height > track.surface + above
    return _Air(air.time[far], air.force[far], air.height[far])


def _inertia_free(track: TrackEvidence, air: _Air) -> tuple[Floats, Floats, Floats]:
    """Force (n,) [N] less the inertia of the tip, speed (n,) [m/s] and height (n,) [m], over blocks of samples."""
    n = _SPEED_SAMPLES
    if len(air.time) < 4 * n:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    speed = (air.height[2 * n :] - air.height[: -2 * n]) / (air.time[2 * n :] - air.time[: -2 * n])
    second = (speed[2 * n :] - speed[: -2 * n]) / (air.time[3 * n : -n] - air.time[n : -3 * n])
    inner = slice(2 * n, -2 * n)
    force = air.force[inner] + (track.tip_mass or 0.0) * second  # height and depth count in opposite directions
    known = np.isfinite(force) & np.isfinite(speed[n:-n])
    return force[known], speed[n:-n][known], air.height[inner][known]


def _regression(columns: Floats, force: Floats) -> tuple[Floats, Floats]:
    """Weights (m,) of columns (n, m) together with a constant, and their standard deviations.

    The noise is that of the means of blocks, so that it may hang together from sample to sample.
    """
    regression = linear_regression(columns - columns.mean(axis=0), force - force.mean())
    noise = _error_of_mean(regression.residual) * math.sqrt(len(force))
    return regression.weights, regression.errors(noise)


def _error_of_mean(values: Floats) -> float:
    """Standard deviation of the mean of values (n,), by the scatter of the means of blocks."""
    blocks = max(len(values) // _BLOCK_SAMPLES, 1)
    if blocks < 5:
        return float(np.std(values) / np.sqrt(max(len(values), 1)))
    means = values[: blocks * _BLOCK_SAMPLES].reshape(blocks, _BLOCK_SAMPLES).mean(axis=1)
    white = float(np.std(values) / np.sqrt(len(values)))
    return max(float(np.std(means, ddof=1) / np.sqrt(blocks)), white)


def _together(flags: Sequence[Flag]) -> dict[str, float]:
    """Standard uncertainty by parameter: the effects of all flags, which have nothing to do with one another."""
    terms: dict[str, float] = {}
    for flag in flags:
        for name, size in (flag.effects or {}).items():
            terms[name] = float(np.hypot(terms.get(name, 0.0), size))
    return terms
