"""Poses that are the commands themselves, perhaps later and rounded: an echo, and no measurement."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

Whole = NDArray[np.int64]
EXACT = 1e-9  # [m] of a pose that is computed in full: rounding of its frames, and of joints from a pose and back
DELAY_STEP = 500_000  # [ns] between two delays that are tried: a quarter of a period
FINE = 1e-6  # [m] of a digit; a quarter of what the tip goes in a period of the retreat
_FINEST, _COARSEST = 8, 5  # decimal digits of a metre: in coarser ones every arm is near its command
_WHOLE = 1e-4  # of the last digit: rounding of a number in binary
_FEW = 16  # places that are compared first


def last_digit(places: Floats) -> float:
    """Return the last decimal digit [m] of places (n, 3); 0 where one has more of them than controllers round to."""
    for digits in range(_COARSEST, _FINEST + 1):
        scaled = places * 10.0**digits
        if float(np.abs(scaled - np.round(scaled)).max()) < _WHOLE:
            return float(10.0**-digits)
    return 0.0


def echo_delay(commands: Floats, sent: Whole, places: Floats, seen: Whole, longest: int) -> int | None:
    """Return by how long [ns] every place is a command that was sent earlier, in its digits; None where one is not.

    `commands` (n, 3) [m] were sent at times (n,) [ns], `places` (m, 3) [m] were seen at times (m,); a delay is at most
    `longest` [ns]. Places from before the first command count for nothing.
    """
    digit = last_digit(places)
    few = np.linspace(0, len(places) - 1, _FEW).astype(np.int64)
    # Read now just before, now just after a command: in fine digits no other arm is at one of the two all the time.
    spare = 1 if digit <= FINE else 0
    for late, due in _latest_commands(sent, seen, longest):
        for chosen in (few, np.arange(len(places))):  # the places of an arm that moves differ at once
            rows = chosen[due[chosen] > spare]
            residuals = [places[rows] - commands[due[rows] - earlier] for earlier in range(spare + 1)]
            if not _are_rounded(residuals, digit):
                break
        else:
            return late
    return None


def _latest_commands(sent: Whole, seen: Whole, longest: int) -> Iterator[tuple[int, Whole]]:
    """Yield delays [ns], and by each which command (m,) was the latest at each place: by count, and by the clock."""
    newest = np.searchsorted(sent, seen, "left").astype(np.int64) - 1
    period = int(np.median(np.diff(sent)))
    for count in range(longest // period + 1):
        yield count * period, newest - count
    for late in range(0, longest + 1, DELAY_STEP):
        yield late, np.searchsorted(sent, seen - late, "right").astype(np.int64) - 1


def _are_rounded(residuals: Sequence[Floats], digit: float) -> bool:
    """Return True if, of residuals (m, 3) [m] from several commands, one is left by rounding, to nearest or by cutting.

    Along each axis all places are rounded alike.
    """
    if not len(residuals[0]):
        return False
    shifts = (-0.5, 0.0, 0.5) if digit else (0.0,)
    largest = [np.min([np.abs(part - shift * digit) for part in residuals], axis=0).max(axis=0) for shift in shifts]
    return bool((np.min(largest, axis=0) <= 0.5 * digit + EXACT).all())
