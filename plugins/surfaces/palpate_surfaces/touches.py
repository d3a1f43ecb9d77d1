"""Touches: where a tip met the skin, from a table of points or from runs that palpated it."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from palpate import ConfigurationError, Floats, suggest, to_si
from palpate_engine import RESULT, bounded_text

from palpate_surfaces.registration_file import file_digest
from palpate_surfaces.run_touches import SkinTouch, touches_of_run

# A heading: a name, and a unit in any brackets or after a separator, as in "x [mm]", "x_mm", "x, mm".
_HEADING = re.compile(r"\s*([a-z]+)\s*(?:[\[(_ ,/]+\s*([a-zµ]+)\s*[\])]?)?\s*", re.IGNORECASE)
_LENGTH_COLUMNS = ("x", "y", "z", "u", "radius")
_COLUMN_NAMES = (*_LENGTH_COLUMNS, "name")
_MAX_TOUCHES = 5000  # a choice


@dataclass(frozen=True)
class Touches:
    """Places of a tip that just touches the skin, in the work frame."""

    position: Floats  # (n, 3) [m] of the tip's end
    radius: Floats  # (n,) [m] of the sphere that the tip ends with; 0 where the place is one of the skin itself
    std: Floats  # (n,) [m] standard uncertainty of where it touched
    name: tuple[str, ...]  # (n,) for messages

    def __len__(self) -> int:
        return len(self.position)

    @property
    def centre(self) -> Floats:
        """Centres (n, 3) [m] of the spheres, above the tool's end: the tool stands along z.

        On an inclined skin the sphere touches off the end.
        """
        return self.position + np.column_stack([np.zeros((len(self), 2)), self.radius])

    @classmethod
    def of(cls, touches: Iterable[SkinTouch]) -> Touches:
        """Return touches one by one as columns."""
        rows = list(touches)
        position = np.array([touch.position for touch in rows]).reshape(-1, 3)
        radius = np.array([touch.radius for touch in rows], float)
        std = np.array([touch.std for touch in rows], float)
        return cls(position, radius, std, tuple(touch.name for touch in rows))


def read_touches(paths: Iterable[Path], uncertainty: float | None = None) -> Touches:
    """Return the touches of tables (.csv) and of runs (a folder, or its result.json).

    `uncertainty` [m] is that of tables without a column u. Raises ConfigurationError, and LogError for damaged runs.
    """
    touches: list[SkinTouch] = []
    for path in paths:
        if path.is_dir():
            touches += touches_of_run(path)
        elif path.suffix == ".json":
            touches += touches_of_run(path.parent)
        else:
            touches += table_touches(path, uncertainty)
    if len(touches) > _MAX_TOUCHES:
        raise ConfigurationError(f"these are {len(touches)} touches; {_MAX_TOUCHES} are allowed")
    return Touches.of(touches)


def touches_table(touches: Touches) -> str:
    """Return touches as a table that `read_touches` reads."""
    rows = ["x [mm],y [mm],z [mm],u [mm],radius [mm],name"]
    columns = zip(touches.position.tolist(), touches.std, touches.radius, touches.name, strict=True)
    for position, std, radius, name in columns:
        numbers = ",".join(f"{1e3 * length:.6f}" for length in (*position, std, radius))
        rows.append(f'{numbers},"{name}"')
    return "\n".join(rows) + "\n"


def touches_digest(path: Path) -> str:
    """Return the SHA-256 of a table, or of the result of a run; raises ConfigurationError for an unreadable one."""
    return file_digest(path / RESULT if path.is_dir() else path)


def table_touches(path: Path, uncertainty: float | None) -> Iterator[SkinTouch]:
    """Yield the touches of a table; `uncertainty` [m] where it has no column u. Raises ConfigurationError."""
    rows = _read_rows(path)
    columns = _read_headings(path, rows[0] if rows else [])
    if "u" not in columns and uncertainty is None:
        raise ConfigurationError(
            f'{path}: how well was it touched? Add a column "u [mm]", the standard uncertainty of each touch, or state '
            "it for all"
        )
    if len(rows) < 2:
        raise ConfigurationError(f"{path}: has no touches below its header")
    name_column = columns["name"][0] if "name" in columns else None
    for number, row in enumerate(rows[1:], 1):
        lengths = {
            name: _read_length(path, number, name, row, column, unit)
            for name, (column, unit) in columns.items()
            if name != "name"
        }
        std, radius = lengths.get("u", uncertainty or 0.0), lengths.get("radius", 0.0)
        if std <= 0 or radius < 0:
            raise ConfigurationError(f"{path}, touch {number}: an uncertainty is above 0, a radius not below 0")
        name = row[name_column].strip() if name_column is not None and len(row) > name_column else ""
        position = (lengths["x"], lengths["y"], lengths["z"])
        yield SkinTouch(position, radius, std, name or f"{path.name}, touch {number}")


def _read_rows(path: Path) -> list[list[str]]:
    """Return the rows of a CSV file that are not empty; raises ConfigurationError for an unreadable one."""
    try:
        lines = bounded_text(path, "utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigurationError(f"{path}: cannot read the touches: {reason}") from error
    return [row for row in csv.reader(lines) if any(cell.strip() for cell in row)]


def _read_headings(path: Path, headings: list[str]) -> dict[str, tuple[int, str]]:
    """Return index and unit of each column by its name; raises ConfigurationError for other headings."""
    columns: dict[str, tuple[int, str]] = {}
    for index, heading in enumerate(headings):
        match = _HEADING.fullmatch(heading)
        name, unit = (match[1].lower(), match[2] or "") if match else (heading.strip(), "")
        if name not in _COLUMN_NAMES:
            raise ConfigurationError(f"{path}: a column is called {heading.strip()!r}{suggest(name, _COLUMN_NAMES)}")
        if name in _LENGTH_COLUMNS and not unit:
            raise ConfigurationError(f'{path}: column {name!r} has no unit; write for example "{name} [mm]"')
        if name in columns:
            raise ConfigurationError(f"{path}: column {name!r} is there twice")
        columns[name] = index, unit
    if missing := [name for name in "xyz" if name not in columns]:
        raise ConfigurationError(f'{path}: has no column {missing[0]!r}; touches are "x [mm],y [mm],z [mm],u [mm]"')
    return columns


def _read_length(path: Path, number: int, name: str, row: list[str], column: int, unit: str) -> float:
    """Return the length [m] of a column in the row of a touch of a number; raises ConfigurationError."""
    cell = row[column].strip() if column < len(row) else ""
    try:
        length = to_si(f"{float(cell)!r} {unit}", "m") if math.isfinite(float(cell)) else math.nan
    except ValueError as error:
        # Messages on the unit are a person's; those of `float` are not.
        reason = str(error) if "unit" in str(error) or " is " in str(error) else f"{cell!r} is not a number"
        raise ConfigurationError(f"{path}, touch {number}, {name}: {reason}") from error
    if not math.isfinite(length):
        raise ConfigurationError(f"{path}, touch {number}, {name}: {cell!r} is not a finite number")
    return length
