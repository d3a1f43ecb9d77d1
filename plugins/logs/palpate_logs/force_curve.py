"""One curve of an atomic force microscope: its columns as recorded, and what its file states of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Floats, LogError

FORCE, TIME, SEGMENT = "force", "time", "segment"
TIP_POSITION, MEASURED, PIEZO = "tip position", "height (measured)", "height (piezo)"
COLUMNS = (FORCE, MEASURED, PIEZO, SEGMENT, TIME, TIP_POSITION)  # by the names of afmformats
APPROACH, RETRACT, PAUSE, BEFORE_APPROACH = 0.0, 1.0, 2.0, 3.0  # kinds of segments, as the channel has them


@dataclass(frozen=True)
class ForceCurve:
    """One curve of a file, whose columns are read only when they are needed."""

    name: str  # in messages: the file, and of several curves the number
    columns: tuple[str, ...]
    read_column: Callable[[str], Any]  # from the name of a column to its readings (n,)
    segment_kinds: tuple[float, ...] = (APPROACH, RETRACT)  # of each segment, in their order
    spring_constant: float | None = None  # [N/m]; None where the file does not state it
    approach_duration: float | None = None  # [s]; None where the file does not state it

    @property
    def force(self) -> Floats:
        """The force (n,) [N]."""
        return self.column(FORCE)

    @property
    def segment(self) -> Floats:
        """The kind of segment (n,) of each reading: `APPROACH` throughout where the file states no segments."""
        if SEGMENT not in self.columns:
            return np.zeros(len(self.force))
        return np.take(np.asarray(self.segment_kinds), self.column(SEGMENT).astype(int), mode="clip")

    def column(self, name: str) -> Floats:
        """Return the readings (n,) of a column as recorded; raises LogError where that is damaged."""
        try:
            return np.asarray(self.read_column(name), np.float64)
        except Exception as error:  # of any kind: the column is unpacked and scaled only now
            label = "" if type(error) is ValueError else f"{type(error).__name__}: "
            raise LogError(f"{self.name}: its {name} cannot be read: {label}{error}") from error

    def time(self, rate: float | None = None) -> Floats | None:
        """Return the time (n,) [s] of the file, else that of a `rate` [Hz]; None without either.

        Raises LogError for a time that does not advance from every reading to the next, and for a rate of a file that
        contains a time.
        """
        if TIME not in self.columns:
            return None if rate is None else np.arange(len(self.force)) / rate
        if rate is not None:
            raise LogError(f"{self.name}: the file contains a time: leave out rate of the device")
        time = self.column(TIME)
        if not np.isfinite(time).all() or np.any(np.diff(time) <= 0):
            raise LogError(f"{self.name}: the time of the curve does not advance from every reading to the next")
        return time

    def height(self, column: str, spring_constant: float | None) -> Floats:
        """Return the height (n,) [m] in a column.

        The tip's, if no column has it, is z + F/k: that of the cantilever z plus force F over spring constant k [N/m],
        which is that of the file if it is None here. Raises LogError if the file lacks the column, z or k.
        """
        available = f"(there are: {', '.join(self.columns)})"
        if column in self.columns:
            return self.column(column)
        if column != TIP_POSITION:
            raise LogError(f"{self.name}: holds no {column!r} {available}")
        spring_constant = spring_constant or self.spring_constant
        if spring_constant is None:
            raise LogError(f"{self.name}: does not state its spring constant: set spring_constant of the device")
        cantilever_column = next((name for name in (MEASURED, PIEZO) if name in self.columns), None)
        if cantilever_column is None:
            raise LogError(f"{self.name}: contains no height {available}")
        return self.column(cantilever_column) + self.force / spring_constant


def positive(number: Any) -> float | None:
    """Return a number that a file states if it is finite and above 0, else None."""
    return float(number) if number is not None and np.isfinite(number) and number > 0 else None
