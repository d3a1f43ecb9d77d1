"""The time that a driver takes of each period: an arm that is commanded 500 times a second cannot wait for it."""

from __future__ import annotations

import math

from palpate import clock

from palpate_arms.setpoint_buffer import PERIOD

# Choices.
_FIRST_JUDGED, _JUDGED_EVERY, _MAX_COUNTED = 16, 64, 512  # cycles after which the mean is judged, and again; at most
_SPARED_EVERY = 10  # of so many cycles the longest does not count: a computer may keep a call waiting now and then
_LARGE_SHARE = 0.5  # of a period: from there on it is the driver that costs periods, else the computer
MAX_LOST = 0.01  # share of the periods of a motion, without a command
_SECOND = 1e9  # [ns]
_MS = 1e3  # per second


class DriverTime:
    """The time that a driver's `read` and `send` take in each cycle, since `begin`."""

    def __init__(self) -> None:
        self._read = self._send = 0  # [ns] in this cycle
        self._cycles: list[tuple[int, int]] = []  # [ns] of both
        self._is_counting = False

    def add_read(self, began: int) -> None:
        """Add a call of `read` that began at a time [ns] and has returned."""
        self._read += clock().now_ns() - began

    def add_send(self, began: int) -> None:
        """Add a call of `send` that began at a time [ns] and has returned."""
        self._send += clock().now_ns() - began

    def begin(self) -> None:
        """Count from now on: the arm moves."""
        self._is_counting = True

    def end_cycle(self) -> None:
        """End a cycle."""
        if self._is_counting and len(self._cycles) < _MAX_COUNTED:
            self._cycles.append((self._read, self._send))
        self._read = self._send = 0

    @property
    def mean(self) -> tuple[float, float]:
        """The mean time of `read` and of `send` [s], without the longest tenth of the cycles."""
        count = len(self._cycles) - math.ceil(len(self._cycles) / _SPARED_EVERY)
        usual = sorted(self._cycles, key=sum)[:count]
        if not usual:
            return 0.0, 0.0
        reads, sends = (sum(times) / max(count, 1) / _SECOND for times in zip(*usual, strict=True))
        return reads, sends

    @property
    def refusal(self) -> str | None:
        """The reason why an arm must not be moved by this driver; None of one that is fast enough."""
        if len(self._cycles) % _JUDGED_EVERY != _FIRST_JUDGED or sum(mean := self.mean) <= PERIOD:
            return None
        return (
            f"its driver is too slow: `read` takes {_MS * mean[0]:.1f} ms and `send` {_MS * mean[1]:.1f} ms of each "
            f"period, of {_MS * PERIOD:g} ms for both; neither may wait for the controller"
        )


def shortfall_text(lost: int, cycles: int, rate: float | None, mean: float) -> str | None:
    """Return the sentence on periods without a command, by the rate [Hz] of the others and the driver's mean time [s].

    None where their share is small, or no rate is known.
    """
    share = lost / max(lost + cycles, 1)
    if share <= MAX_LOST or rate is None:
        return None
    is_slow_driver = mean > _LARGE_SHARE * PERIOD
    cause = f"its driver takes {_MS * mean:.1f} ms of each" if is_slow_driver else "the computer was late"
    return (
        f"{share:.1%} of the arm's periods had no command: commands went out at {rate:.0f} Hz in place of "
        f"{1.0 / PERIOD:.0f} Hz, since {cause}; the motion was slower than planned where it was not made up for"
    )
