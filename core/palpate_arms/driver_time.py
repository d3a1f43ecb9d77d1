"""The time that a driver takes of each period: an arm that is commanded 500 times a second cannot wait for it."""

from __future__ import annotations

import math

from palpate import clock

from palpate_arms.setpoint_buffer import PERIOD

_ENOUGH, _EVERY, _LONGEST = 16, 64, 512  # cycles after which the mean is judged first, and again; at most
_SPARED = 10  # of so many cycles the longest does not count: a computer may keep a call waiting now and then
MAX_LOST = 0.01  # of the periods of a motion, without a command


class DriverTime:
    """How long the driver's `read` and `send` take in each cycle, since `begin`."""

    def __init__(self) -> None:
        self._read = self._send = 0  # [ns] in this cycle
        self._cycles: list[tuple[int, int]] = []  # [ns] of both
        self._is_counting = False

    def add_read(self, began: int) -> None:
        """A call of `read` that began at a time [ns] has returned."""
        self._read += clock().now_ns() - began

    def add_send(self, began: int) -> None:
        """A call of `send` that began at a time [ns] has returned."""
        self._send += clock().now_ns() - began

    def begin(self) -> None:
        """The arm moves from now on."""
        self._is_counting = True

    def end_cycle(self) -> None:
        """A cycle is over."""
        if self._is_counting and len(self._cycles) < _LONGEST:
            self._cycles.append((self._read, self._send))
        self._read = self._send = 0

    @property
    def mean(self) -> tuple[float, float]:
        """Of `read` and of `send` [s], without the longest tenth of the cycles."""
        count = len(self._cycles) - math.ceil(len(self._cycles) / _SPARED)
        usual = sorted(self._cycles, key=sum)[:count]
        reads, sends = (sum(times) / max(count, 1) / 1e9 for times in zip(*usual, strict=True)) if usual else (0.0, 0.0)
        return reads, sends

    @property
    def refusal(self) -> str | None:
        """Why an arm is not to be moved by this driver; None of one that is fast enough."""
        if len(self._cycles) % _EVERY != _ENOUGH or sum(mean := self.mean) <= PERIOD:
            return None
        return (
            f"its driver is too slow: `read` takes {1e3 * mean[0]:.1f} ms and `send` {1e3 * mean[1]:.1f} ms of each "
            f"period, of {1e3 * PERIOD:g} ms for both; neither may wait for the controller"
        )


def shortfall_text(lost: int, cycles: int, rate: float | None, mean: float) -> str | None:
    """What is said of periods without a command, by the rate [Hz] of the others and the driver's `mean` time [s]."""
    share = lost / max(lost + cycles, 1)
    if share <= MAX_LOST or rate is None:
        return None
    cause = f"its driver takes {1e3 * mean:.1f} ms of each" if mean > 0.5 * PERIOD else "the computer was late"
    return (
        f"{share:.1%} of the arm's periods had no command: commands went out at {rate:.0f} Hz in place of "
        f"{1.0 / PERIOD:.0f} Hz, since {cause}; the motion was slower than planned where it was not made up for"
    )
