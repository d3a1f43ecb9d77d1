"""A motion in the log that was commanded, and not measured: what its own noise shows."""

from __future__ import annotations

import numpy as np
from palpate import Floats, TrackEvidence

# A joint's encoders give a tip 5 um of noise, 1e-3 of a palpation's way; a command in the same logs has 0.05 um.
_MIN_HEIGHT_NOISE = 2e-7  # [m] noise that no arm's encoders stay below
_MIN_NOISE_SHARE = 1e-4  # of the way, that the noise of a measured one is never below
_MIN_WAY = 2e-4  # [m] of way; less is that of an instrument with other sensors
_MIN_SAMPLES = 500  # of a motion that may be a command


def share_of_command(noise: float, way: float) -> float:
    """By how much a position with a noise [m] on a way [m] counts as the command, from 0 to 1.

    It grows from 0 for the least noise of a measured one to 1 at half of that: records that differ in nothing but
    their noise must not differ in their uncertainty by a factor.

    >>> share_of_command(5e-8, 4e-3), share_of_command(2e-7, 4e-3)
    (1.0, 0.0)
    """
    least = min(_MIN_HEIGHT_NOISE, _MIN_NOISE_SHARE * way)
    if way < _MIN_WAY or not noise < least:
        return 0.0
    return min(float(np.log2(least / noise)), 1.0) if noise > 0.0 else 1.0


def position_noise(track: TrackEvidence) -> tuple[float, float]:
    """Standard deviation [m] of the position's noise by its fourth differences, and the way [m] that it goes.

    Fourth differences of white noise have 70 times its variance, and those of a sine of a few hertz next to none.
    """
    height, runs = track.kept.position, track.kept.runs
    whole = runs[4:] == runs[:-4]
    fourth: Floats = np.diff(height, 4)[whole]
    fourth = fourth[np.isfinite(fourth)]
    if len(fourth) < _MIN_SAMPLES:
        return float("nan"), 0.0
    return 1.4826 * float(np.median(np.abs(fourth))) / float(np.sqrt(70.0)), float(
        np.nanmax(height) - np.nanmin(height)
    )
