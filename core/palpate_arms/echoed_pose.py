"""Poses that are the commands themselves, perhaps later and rounded: an echo, and no measurement."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

Whole = NDArray[np.int64]
EXACT = 3e-8  # [m], a choice: of a pose that is computed in full; 3 times what an inverse kinematics leaves
DELAY_STEP = 500_000  # [ns], a choice: between two delays that are tried, a quarter of a period
FINE = 1e-6  # [m] of a digit, a choice: a quarter of what the tip goes in a period of the retreat
_FINEST, _COARSEST = 8, 5  # decimal digits of a metre, a choice: in coarser ones every arm is near its command
_BINARY_ROUNDING = 1e-4  # of the last digit, a choice: rounding of a number in binary
_FIRST_COMPARED = 16  # places, a choice: the places of an arm that moves differ at once
_ROUNDING_SHIFTS = (-0.5, 0.0, 0.5)  # digits, middle of place less command: cut downwards, rounded, cut upwards
_HALF_DIGIT = 0.5  # of the last digit, by which rounding is off at most


def last_digit(places: Floats) -> float:
    """Return the last decimal digit [m] of places (n, 3); 0 where one has more of them than controllers round to."""
    for digits in range(_COARSEST, _FINEST + 1):
        scaled = places * 10.0**digits
        if float(np.abs(scaled - np.round(scaled)).max()) < _BINARY_ROUNDING:
            return float(10.0**-digits)
    return 0.0


def echo_delay(commands: Floats, sent: Whole, places: Floats, arrivals: Whole, longest: int) -> int | None:
    """Return by how long [ns] every place is a command that was sent earlier, in its digits; None where one is not.

    `commands` (n, 3) [m] were sent at times (n,) [ns], `places` (m, 3) [m] were seen at times (m,); a delay is at most
    `longest` [ns]. Places from before the first command count for nothing.
    """
    digit = last_digit(places)
    sample = np.linspace(0, len(places) - 1, _FIRST_COMPARED).astype(np.int64)
    # Read now just before, now just after a command: in fine digits no other arm is at one of the two all the time.
    spare = 1 if digit <= FINE else 0
    for delay, latest in _latest_commands(sent, arrivals, longest):
        # A sample of the places first, then all of them; `latest` is the number of a command, or below 0.
        for candidates in (sample, np.arange(len(places))):
            rows = candidates[latest[candidates] > spare]
            residuals = [places[rows] - commands[latest[rows] - earlier] for earlier in range(spare + 1)]
            if not _are_rounded(residuals, digit):
                break
        else:
            return delay
    return None


def _latest_commands(sent: Whole, arrivals: Whole, longest: int) -> Iterator[tuple[int, Whole]]:
    """Yield delays [ns], each with the numbers (m,) of the latest commands by then: by count, and by the clock."""
    newest = np.searchsorted(sent, arrivals, "left").astype(np.int64) - 1
    period = int(np.median(np.diff(sent)))
    for count in range(longest // period + 1):
        yield count * period, newest - count
    for delay in range(0, longest + 1, DELAY_STEP):
        yield delay, np.searchsorted(sent, arrivals - delay, "right").astype(np.int64) - 1


def _are_rounded(residuals: Sequence[Floats], digit: float) -> bool:
    """Return True if, of residuals (m, 3) [m] from several commands, one is left by rounding, to nearest or by cutting.

    Along each axis all places are rounded alike.
    """
    if not len(residuals[0]):
        return False
    shifts = _ROUNDING_SHIFTS if digit else (0.0,)
    # By each shift and axis the largest residual, of the nearest command to each place.
    largest = [np.min([np.abs(part - shift * digit) for part in residuals], axis=0).max(axis=0) for shift in shifts]
    return bool((np.min(largest, axis=0) <= _HALF_DIGIT * digit + EXACT).all())
