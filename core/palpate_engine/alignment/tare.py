"""The tare: what the sensor reads in free air."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from palpate.alignment_report import Tare
from palpate.alignment_settings import AlignmentSettings
from palpate.errors import LogError
from palpate.estimation import Samples
from palpate.vectors import Floats

from palpate_engine.alignment.change_point import change_point, even_parts

_MIN_SAMPLES = 10  # of a mean and its standard deviation; a choice
_REST_PARTS = 6  # of a record at rest, whose means are compared; a choice
_ROBOT_DRIFT = 0.02  # [N] standard deviation of these means that is a robot's drift, whatever the noise; a choice
_MAX_DRIFT = 1.5  # standard deviations within the parts: the same, by the noise; a choice


def stated_tare(settings: AlignmentSettings) -> Tare | None:
    """Return the tare that the settings state; None where it is to be measured."""
    if settings.tare == "free-air":
        return None
    return Tare(0.0 if settings.tare == "none" else float(settings.tare), settings.tare_uncertainty, None)


def measured_tare(settings: AlignmentSettings, samples: Samples, before: float = np.inf) -> Tare:
    """Return the mean force of the first `tare_duration` before a time [s], less any contact at the end of it.

    Of fewer than ten readings the tare is 0, without an uncertainty. Raises LogError where the force is not at rest.
    """
    end = min(before, settings.tare_duration)
    window = where(samples, (samples.time <= end) & (samples.time < before))
    window = where(window, np.isfinite(window.force))
    if len(window) < _MIN_SAMPLES:
        return Tare(0.0, None, None)
    air = _before_contact(window)
    if air is not None:
        window, end = air, float(air.time[-1])
    force = window.force
    spread = float(force.std(ddof=1))
    if not _is_at_rest(force):
        raise LogError(
            f"alignment: the first {settings.tare_duration:g} s of {settings.force.channel} are not at rest in free "
            f"air (the force wanders by {spread:.2g} N), so they give no tare; set [alignment] tare = "
            '"none", a force, or a shorter tare_duration'
        )
    # Rounded once, so that a filter on another machine finds the same bits whatever order it adds in.
    mean = math.fsum(force.tolist()) / len(force)
    return Tare(offset=mean, offset_std=spread / np.sqrt(len(force)), noise=spread, until=end)


def _before_contact(window: Samples) -> Samples | None:
    """Return the samples of a window before the contact that it ends with; None without a change point.

    Contact is what lies below the surface without interruption up to the end. None as well where too little air
    precedes it.
    """
    change = change_point(window.position, window.force)
    if change is None:
        return None
    below = window.position < change.surface
    air_count = len(window) - int(np.argmin(below[::-1])) if not below.all() else 0
    return window[:air_count] if air_count >= _MIN_SAMPLES else None


def where(samples: Samples, rows: NDArray[np.bool_]) -> Samples:
    """Return the samples of the rows that are True; without a copy where these are the first ones."""
    count = int(np.count_nonzero(rows))
    return samples[:count] if rows[:count].all() else samples[rows]


def _is_at_rest(force: Floats) -> bool:
    """Return True if a record scatters within its parts rather than wandering from one to the next."""
    edges, sizes = even_parts(len(force), _REST_PARTS)
    means = np.add.reduceat(force, edges) / sizes
    drift = float(means.std())
    residual = force - np.repeat(means, sizes)
    noise = float(np.sqrt(np.add.reduceat(residual * residual, edges) / sizes).mean())
    return drift <= _ROBOT_DRIFT or drift <= _MAX_DRIFT * noise
