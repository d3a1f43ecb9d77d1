"""The setpoints of a motion, one for each period of the servo loop, of which only the next few are held in memory."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import IO

import numpy as np
from palpate import Floats, Setpoint, Surface, Trajectory, duration_of, setpoints_at, surface_of, surface_points

from palpate_arms.setpoint_rows import PLAN, SETPOINT

PERIOD = 0.002  # [s], that of a UR's controller: 500 commands a second
# Choices.
_PIECE = 2048  # rows that are checked at a time, in a tenth of a period
_BLOCK = 512  # rows that are read at a time, a second of the motion
_ROUNDING = 1e-9  # periods: rounding of a whole number of them
_AHEAD = 32  # blocks; so early the system is asked for one
_COMMON = 2  # rows of two pieces: accelerations are of three rows
_ROW_BYTES = 8 * PLAN.size  # float64
_PLACE = PLAN["position"]
_ACROSS = slice(_PLACE.start, _PLACE.start + 2)
_LEVEL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)  # no turn, and the plane of the work frame


class Plan:
    """Rows (16,) of setpoints with the planes of their stations, in their order. Read from the first to the last."""

    def __init__(self, count: int, read: Callable[[int, int], Floats], ask: Callable[[int, int], None]) -> None:
        self._count, self._read, self._ask = count, read, ask
        self._blocks: dict[int, Floats] = {}  # two at most
        # [m/s], [rad/s], [m] of the rows that were checked
        self.fastest, self.fastest_turn, self.lowest = 0.0, 0.0, np.inf
        self.lateral = 0.0  # [m] across the normal of the work frame, from the first row, along an axis
        self.ends = np.zeros((2, PLAN.size))  # first and last row that were checked

    @classmethod
    def of(cls, table: Floats) -> Plan:
        """Return a plan of rows (n, 16), or (n, 7) without a turn, in memory and with its extremes."""
        if table.shape[1] == SETPOINT.size:
            table = np.hstack([table, np.tile(_LEVEL, (len(table), 1))])
        plan = cls(len(table), lambda first, last: table[first:last], lambda first, last: None)
        for _ in plan.pieces():
            pass
        return plan

    @classmethod
    def in_file(cls, descriptor: int, count: int) -> Plan:
        """Return a plan of so many rows in an open file."""

        def read(first: int, last: int) -> Floats:
            data = os.pread(descriptor, (last - first) * _ROW_BYTES, first * _ROW_BYTES)
            return np.frombuffer(data, np.float64).reshape(-1, PLAN.size)

        def ask(first: int, last: int) -> None:
            if hasattr(os, "posix_fadvise"):
                start, length = first * _ROW_BYTES, (last - first) * _ROW_BYTES
                os.posix_fadvise(descriptor, start, length, os.POSIX_FADV_WILLNEED)

        return cls(count, read, ask)

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, row: int) -> Floats:
        """Return a copy of a row (16,)."""
        number, place = divmod(row, _BLOCK)
        block = self._blocks.get(number)
        if block is None:
            # The previous block stays, for a motion that goes back a little; the system reads ahead.
            self._blocks = {key: rows for key, rows in self._blocks.items() if key == number - 1}
            first = number * _BLOCK
            block = self._blocks[number] = self._read(first, min(first + _BLOCK, self._count))
            self._ask(first + _AHEAD * _BLOCK, first + (_AHEAD + 1) * _BLOCK)
        return np.array(block[place])

    def pieces(self) -> Iterator[Floats]:
        """Yield all rows (n, 16), piece by piece; each begins with the last two rows of the one before."""
        for first in range(0, self._count, _PIECE):
            rows = self._read(max(first - _COMMON, 0), min(first + _PIECE, self._count))
            # Speeds from row to row, and the extremes of all rows so far.
            ways = np.linalg.norm(np.diff(rows[:, _PLACE], axis=0), axis=1)
            self.fastest = max(self.fastest, float(ways.max(initial=0.0)) / PERIOD)
            turns = np.linalg.norm(np.diff(rows[:, PLAN["turn"]], axis=0), axis=1)
            self.fastest_turn = max(self.fastest_turn, float(turns.max(initial=0.0)) / PERIOD)
            self.ends[1] = rows[-1]
            if first == 0:
                self.ends[0] = rows[0]
            self.lateral = max(self.lateral, float(np.abs(rows[:, _ACROSS] - self.ends[0, _ACROSS]).max(initial=0.0)))
            self.lowest = min(self.lowest, float(rows[:, _PLACE.stop - 1].min()))  # of z, the last of three columns
            yield rows


@contextmanager
def write_setpoints(trajectory: Trajectory, axes: Floats | None = None) -> Iterator[tuple[IO[bytes], int]]:
    """Yield a file without a name that holds the setpoints of a motion, and their number; raises OSError.

    Planes of a surface are looked up here, before anything moves: in the servo loop nothing is. `axes` (3, 3) are those
    of the work frame in the frame of a tool that is not turned.
    The file is on the disk, which may be full, and not in memory: of a motion of hours the system may put aside what
    comes later.
    """
    # A row for each whole period, piece by piece, so that little is held in memory.
    count, surface = int(np.floor(duration_of(trajectory) / PERIOD + _ROUNDING)) + 1, surface_of(trajectory)
    with tempfile.TemporaryFile(prefix="palpate-") as file:
        for first in range(0, count, _PIECE):
            times = np.asarray(np.arange(first, min(first + _PIECE, count)) * PERIOD, np.float64)
            setpoint = setpoints_at(trajectory, times)
            rows = _rows(setpoint, surface, np.eye(3) if axes is None else axes)
            file.write(np.ascontiguousarray(rows, np.float64).tobytes())
        file.flush()
        yield file, count


def _rows(setpoint: Setpoint, surface: Surface | None, axes: Floats) -> Floats:
    """Return rows (n, 16) of setpoints, with the planes of a surface below them."""
    rows = np.empty((len(setpoint.position), PLAN.size))
    rows[:, PLAN["position"]], rows[:, PLAN["velocity"]] = setpoint.position, setpoint.velocity
    rows[:, PLAN.at("measuring")] = setpoint.measuring
    rows[:, PLAN.span("turn", "normal")] = _LEVEL
    if setpoint.rotation is not None:
        rows[:, PLAN["turn"]] = setpoint.rotation @ axes.T
    if surface is not None:
        points = surface_points(surface, setpoint.position)
        rows[:, PLAN["foot"]], rows[:, PLAN["normal"]] = points.position, points.normal
    return rows
