"""A motion in the log that was commanded, and not measured: what its own noise shows."""

from __future__ import annotations

import numpy as np
from palpate import Floats, TrackEvidence

from palpate_uncertainty.channel_noise import MEDIAN_TO_STD

# A joint's encoders give a tip 5 um of noise, 1e-3 of a palpation's way; a command in the same logs has 0.05 um.
_MIN_HEIGHT_NOISE = 2e-7  # [m] noise that no arm's encoders stay below
_MIN_NOISE_SHARE = 1e-4  # of the way, that the noise of a measured one is never below
_MIN_WAY = 2e-4  # [m] of way; less is that of an instrument with other sensors
_MIN_SAMPLES = 500  # of a motion that may be a command (choice)
_DIFFERENCES = 4  # order of the differences that show the noise
_DIFFERENCE_VARIANCE = 70.0  # variance of fourth differences of white noise of variance 1: 1 + 16 + 36 + 16 + 1


def share_of_command(noise: float, way: float) -> float:
    """Return the degree, from 0 to 1, to which a position with a noise [m] on a way [m] counts as the command.

    It grows from 0 for the least noise of a measured one to 1 at half of that: records that differ in nothing but
    their noise must not differ in their uncertainty by a factor.

    >>> share_of_command(5e-8, 4e-3), share_of_command(2e-7, 4e-3)
    (1.0, 0.0)
    """
    min_noise = min(_MIN_HEIGHT_NOISE, _MIN_NOISE_SHARE * way)
    if way < _MIN_WAY or not noise < min_noise:
        return 0.0
    return min(float(np.log2(min_noise / noise)), 1.0) if noise > 0.0 else 1.0


def position_noise(track: TrackEvidence) -> tuple[float, float]:
    """Return the standard deviation [m] of the position's noise by its fourth differences, and its way [m].

    Fourth differences of white noise have 70 times its variance, and those of a sine of a few hertz next to none.
    """
    height, runs = track.kept.position, track.kept.runs
    is_in_one_run = runs[_DIFFERENCES:] == runs[:-_DIFFERENCES]
    differences: Floats = np.diff(height, _DIFFERENCES)[is_in_one_run]
    differences = differences[np.isfinite(differences)]
    if len(differences) < _MIN_SAMPLES:
        return float("nan"), 0.0
    std = MEDIAN_TO_STD * float(np.median(np.abs(differences)))
    way = float(np.nanmax(height) - np.nanmin(height))
    return std / float(np.sqrt(_DIFFERENCE_VARIANCE)), way
