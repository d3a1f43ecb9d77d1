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
WAY_IN, WAY_OUT, REST, BEFORE = 0.0, 1.0, 2.0, 3.0  # what a segment is


@dataclass(frozen=True)
class ForceCurve:
    """One curve of a file, whose columns are read when they are asked for."""

    name: str  # in messages: the file, and of several curves the number
    columns: tuple[str, ...]
    read: Callable[[str], Any]  # a column (n,)
    ways: tuple[float, ...] = (WAY_IN, WAY_OUT)  # what each segment is
    spring_constant: float | None = None  # [N/m]; None where the file does not state it
    duration: float | None = None  # of the way in [s], as above

    @property
    def force(self) -> Floats:
        """(n,) [N]."""
        return self.column(FORCE)

    @property
    def segment(self) -> Floats:
        """(n,) 0 on the way in, 1 on the way out, 2 between, 3 before; 0 throughout where the file does not say it."""
        if SEGMENT not in self.columns:
            return np.zeros(len(self.force))
        return np.take(np.asarray(self.ways), self.column(SEGMENT).astype(int), mode="clip")

    def column(self, name: str) -> Floats:
        """(n,) as recorded; raises LogError where that is damaged."""
        try:
            return np.asarray(self.read(name), np.float64)
        except Exception as error:  # read now, not when the file was opened: unpacked, scaled, put together
            label = "" if type(error) is ValueError else f"{type(error).__name__}: "
            raise LogError(f"{self.name}: its {name} cannot be read: {label}{error}") from error

    def time(self, rate: float | None = None) -> Floats | None:
        """(n,) [s] that advances from every reading to the next; None where neither file nor `rate` gives it.

        Raises LogError where the file contains a time as well.
        """
        if TIME not in self.columns:
            return None if rate is None else np.arange(len(self.force)) / rate
        if rate is not None:
            raise LogError(f"{self.name}: the file contains a time: leave out rate of the device")
        time = self.column(TIME)
        if not np.isfinite(time).all() or np.any(np.diff(time) <= 0):
            raise LogError(f"{self.name}: the time of the curve does not advance from every reading to the next")
        return time

    def height(self, column: str, stiffness: float | None) -> Floats:
        """(n,) [m] of the tip, the column of that name or force over `stiffness` above the cantilever's; else a column.

        Raises LogError where the file lacks it.
        """
        available = f"(there are: {', '.join(self.columns)})"
        if column in self.columns:
            return self.column(column)
        if column != TIP_POSITION:
            raise LogError(f"{self.name}: holds no {column!r} {available}")
        stiffness = stiffness or self.spring_constant
        if stiffness is None:
            raise LogError(f"{self.name}: does not state its spring constant: set spring_constant of the device")
        base = next((name for name in (MEASURED, PIEZO) if name in self.columns), None)
        if base is None:
            raise LogError(f"{self.name}: contains no height {available}")
        return self.column(base) + self.force / stiffness


def positive(number: Any) -> float | None:
    """Return a number that a file states, where it is finite and above 0; None for any other."""
    return float(number) if number is not None and np.isfinite(number) and number > 0 else None
