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

_WANDER = 0.02  # [N] of a robot; less is drift
_FEWEST = 10  # samples


def stated_tare(settings: AlignmentSettings) -> Tare | None:
    """Return the tare that the settings say; None where it is to be measured."""
    if settings.tare == "free-air":
        return None
    return Tare(0.0 if settings.tare == "none" else float(settings.tare), settings.tare_uncertainty, None)


def measured_tare(settings: AlignmentSettings, samples: Samples, before: float = np.inf) -> Tare:
    """Mean of the first `tare_duration`, of what is before a time [s] of it, and of no contact within.

    Raises LogError where the force is not at rest in what is left.
    """
    ends = min(before, settings.tare_duration)
    window = where(samples, (samples.time <= ends) & (samples.time < before))
    window = where(window, np.isfinite(window.force))
    if len(window) < _FEWEST:
        return Tare(0.0, None, None)
    found = change_point(window.position, window.force)
    if found is not None:
        below = window.position < found.surface
        # Contact is what lies below the surface without interruption up to the end of the window.
        count = len(window) - int(np.argmin(below[::-1])) if not below.all() else 0
        if count >= _FEWEST:
            window = window[:count]
            ends = float(window.time[-1])
    force = window.force
    spread = float(force.std(ddof=1))
    if not _at_rest(force):
        raise LogError(
            f"alignment: the first {settings.tare_duration:g} s of {settings.force.channel} are not at rest in free "
            f"air (the force wanders by {spread:.2g} N), so they give no tare; set [alignment] tare = "
            '"none", a force, or a shorter tare_duration'
        )
    # Rounded once, so that a filter on another machine finds the same bits whatever order it adds in.
    return Tare(math.fsum(force.tolist()) / len(force), spread / np.sqrt(len(force)), spread, ends)


def where(samples: Samples, rows: NDArray[np.bool_]) -> Samples:
    """Return the samples for which something holds; without a copy where these are the first ones."""
    count = int(np.count_nonzero(rows))
    return samples[:count] if rows[:count].all() else samples[rows]


def _at_rest(force: Floats) -> bool:
    """Return True if a record scatters within its sixths rather than wandering from one to the next."""
    edges, sizes = even_parts(len(force), 6)
    means = np.add.reduceat(force, edges) / sizes
    between = float(means.std())
    apart = force - np.repeat(means, sizes)
    within = float(np.sqrt(np.add.reduceat(apart * apart, edges) / sizes).mean())
    return between <= _WANDER or between <= 1.5 * within
