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

_COLUMN = re.compile(r"\s*([a-z]+)\s*(?:[\[(_ ,/]+\s*([a-zµ]+)\s*[\])]?)?\s*", re.IGNORECASE)
_LENGTHS = ("x", "y", "z", "u", "radius")
_NAMES = (*_LENGTHS, "name")
_MOST = 5000  # touches


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
        """(n, 3) [m] of the spheres: the tool stands along z, its sphere touches an inclined skin off its end."""
        return self.position + np.column_stack([np.zeros((len(self), 2)), self.radius])

    @classmethod
    def of(cls, touches: Iterable[SkinTouch]) -> Touches:
        """Touches one by one, as columns."""
        rows = list(touches)
        position = np.array([touch.position for touch in rows]).reshape(-1, 3)
        radius, std = (np.array([getattr(touch, key) for touch in rows], float) for key in ("radius", "std"))
        return cls(position, radius, std, tuple(touch.name for touch in rows))


def read_touches(paths: Iterable[Path], uncertainty: float | None = None) -> Touches:
    """Return the touches of tables (.csv) and of runs (a folder, or its result.json).

    `uncertainty` [m] is that of tables without a column u. Raises ConfigurationError, and LogError for damaged runs.
    """
    found: list[SkinTouch] = []
    for path in paths:
        is_run = path.is_dir() or path.suffix == ".json"
        found += touches_of_run(path if path.is_dir() else path.parent) if is_run else table_touches(path, uncertainty)
    if len(found) > _MOST:
        raise ConfigurationError(f"these are {len(found)} touches; {_MOST} are allowed")
    return Touches.of(found)


def touches_table(touches: Touches) -> str:
    """Touches as a table that `read_touches` reads."""
    rows = ["x [mm],y [mm],z [mm],u [mm],radius [mm],name"]
    columns = zip(touches.position.tolist(), touches.std, touches.radius, touches.name, strict=True)
    for place, u, radius, name in columns:
        numbers = ",".join(f"{1e3 * value:.6f}" for value in (*place, u, radius))
        rows.append(f'{numbers},"{name}"')
    return "\n".join(rows) + "\n"


def digest_of(path: Path) -> str:
    """SHA-256 of a table, or of the result of a run; raises ConfigurationError where it cannot be read."""
    return file_digest(path / RESULT if path.is_dir() else path)


def table_touches(path: Path, uncertainty: float | None) -> Iterator[SkinTouch]:
    """Yield the touches of a table; `uncertainty` [m] where it has no column u. Raises ConfigurationError."""
    try:
        lines = bounded_text(path, "utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigurationError(f"{path}: cannot read the touches: {reason}") from error
    rows = [row for row in csv.reader(lines) if any(cell.strip() for cell in row)]
    columns = _columns(path, rows[0] if rows else [])
    if "u" not in columns and uncertainty is None:
        raise ConfigurationError(
            f'{path}: how well was it touched? Add a column "u [mm]", the standard uncertainty of each touch, or state '
            "it for all"
        )
    if len(rows) < 2:
        raise ConfigurationError(f"{path}: has no touches below its header")
    for number, row in enumerate(rows[1:], 1):
        values = {key: _length(path, number, key, row, *at) for key, at in columns.items() if key != "name"}
        std = values.get("u", uncertainty or 0.0)
        if std <= 0 or values.get("radius", 0.0) < 0:
            raise ConfigurationError(f"{path}, touch {number}: an uncertainty is above 0, a radius not below 0")
        name = row[columns["name"][0]].strip() if "name" in columns and len(row) > columns["name"][0] else ""
        place = (values["x"], values["y"], values["z"])
        yield SkinTouch(place, values.get("radius", 0.0), std, name or f"{path.name}, touch {number}")


def _columns(path: Path, header: list[str]) -> dict[str, tuple[int, str]]:
    """Place and unit of each column by its name; raises ConfigurationError."""
    found: dict[str, tuple[int, str]] = {}
    for place, cell in enumerate(header):
        match = _COLUMN.fullmatch(cell)
        name, unit = (match[1].lower(), match[2] or "") if match else (cell.strip(), "")
        if name not in _NAMES:
            raise ConfigurationError(f"{path}: a column is called {cell.strip()!r}{suggest(name, _NAMES)}")
        if name in _LENGTHS and not unit:
            raise ConfigurationError(f'{path}: column {name!r} has no unit; write for example "{name} [mm]"')
        if name in found:
            raise ConfigurationError(f"{path}: column {name!r} is there twice")
        found[name] = place, unit
    if missing := [name for name in "xyz" if name not in found]:
        raise ConfigurationError(f'{path}: has no column {missing[0]!r}; touches are "x [mm],y [mm],z [mm],u [mm]"')
    return found


def _length(path: Path, number: int, key: str, row: list[str], place: int, unit: str) -> float:
    cell = row[place].strip() if place < len(row) else ""
    try:
        value = to_si(f"{float(cell)!r} {unit}", "m") if math.isfinite(float(cell)) else math.nan
    except ValueError as error:
        reason = str(error) if "unit" in str(error) or " is " in str(error) else f"{cell!r} is not a number"
        raise ConfigurationError(f"{path}, touch {number}, {key}: {reason}") from error
    if not math.isfinite(value):
        raise ConfigurationError(f"{path}, touch {number}, {key}: {cell!r} is not a finite number")
    return value
