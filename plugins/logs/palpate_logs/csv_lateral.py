"""The columns of a table that say where along the skin the tip is: by their names, or as stated."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from palpate import Floats, LogError
from palpate_records.messages.readings import si_unit
from palpate_records.tables.csv_names import bare_name, is_another_quantity, role_by_words, words_of
from palpate_records.tables.csv_sheet import Sheet, column_text

LATERAL = "lateral"  # the option: one column, or that of x and that of y
_AXES = ("x", "y")
_ELEMENT = re.compile(r".*pose[_.\[]([01])\]?")  # of a pose: actual_TCP_pose_0
_COMMANDED = {"target", "desired", "setpoint", "command", "commanded", "reference", "goal"}
_MIN_WAY = 2e-3  # [m] from which on a record is a sweep: that of the result (decision 0127)
_MAX_WAY = 0.5  # [m], a choice: what an arm palpates in one record
_ALIKE = 0.98  # correlation with the height, from which on a column is the height again: a choice
_STEADY = 0.99  # correlation with the row, from which on a column may be the place along a sweep: a choice
_TIME = 0.9999  # correlation with the row, from which on a column is a time: a choice
_SPEED_STEP, _SPEED_SHARE, _FASTEST = 0.2, 0.5, 0.9  # [s], of the quantile, and that quantile of speeds: choices
_TINY = 1e-300  # keeps the largest number of a column of zeros above 0
_UNITS = ("mm", "m", "um")  # that a column without a unit may have


@dataclass
class LateralColumns:
    """The columns of x and y, and what is not certain about them."""

    columns: dict[str, dict[str, Any]] = field(default_factory=dict)  # by axis
    places: list[Floats] = field(default_factory=list)  # (n,) [m] of each of them
    doubts: list[str] = field(default_factory=list)
    hints: list[str] = field(default_factory=list)

    def add(self, axis: str, sheet: Sheet, k: int, values: Floats, unit: str) -> None:
        """Add column k of a sheet with values (n, columns) in a unit."""
        self.columns[axis] = {"column": sheet.column(k), "unit": unit}
        self.places.append(values[:, k] * si_unit(unit)[1])

    def speed(self, time: Floats) -> float:
        """Return the speed [m/s] along the skin at times (n,) [s] while the tip moves on; NaN where it never does.

        By steps of 0.2 s, in which the noise of a place does not count: the median of those that are half as fast as
        the fastest tenth or faster.
        """
        place = np.column_stack(self.places)
        rows = np.flatnonzero(np.isfinite(place).all(axis=1))
        stride = max(round(_SPEED_STEP / float(np.median(np.diff(time)))), 1)
        rows = rows[::stride]
        steps = np.linalg.norm(np.diff(place[rows], axis=0), axis=1) / np.diff(time[rows])
        if not len(steps):
            return math.nan
        return float(np.median(steps[steps >= _SPEED_SHARE * np.quantile(steps, _FASTEST)]))


def lateral_columns(
    sheet: Sheet, values: Floats, picks: Mapping[str, int], unit: str, stated: str | None
) -> LateralColumns:
    """Return the lateral columns of a sheet with values (n, columns): those stated, else those that names say.

    `picks` are the columns of force and motion by role, `unit` that of the position. Columns named x or y, or elements
    of a pose, that go 2 mm and more and are not the height again; none that differs from a force or a velocity by its
    axis alone. Of a column that only moves as if it were one a hint asks. Raises LogError for a stated column that is
    missing, or does not move like a place.
    """
    if stated is not None:
        return _stated_columns(sheet, values, picks, unit, stated)
    lateral = LateralColumns()
    height = values[:, picks["position"]]
    vectors = {sheet.names[k][:-1] for role, k in picks.items() if role != "position"} - {""}
    for k, name in enumerate(sheet.names):
        axis = None if k in picks.values() or name[:-1] in vectors else _axis_of(name)
        if axis is None or axis in lateral.columns or _correlation(values[:, k], height) > _ALIKE:
            continue
        own_unit = sheet.unit(k) or unit
        if si_unit(own_unit)[0] == "m" and _way(values[:, k], own_unit) >= _MIN_WAY:
            lateral.add(axis, sheet, k, values, own_unit)
    if not lateral.columns:
        lateral.hints += _hints(sheet, values, picks.values(), height)
    return lateral


def _stated_columns(sheet: Sheet, values: Floats, picks: Mapping[str, int], unit: str, stated: str) -> LateralColumns:
    """Return the columns that --lateral names; raises LogError where one is another channel, or moves like no place."""
    names = [name.strip() for name in stated.split(",")]
    if len(names) > len(_AXES):
        raise LogError(f"{sheet.path}: --lateral: {len(names)} columns; name one, or that of x and that of y")
    lateral = LateralColumns()
    for position, name in enumerate(names):
        k = sheet.index_of(LATERAL, name)
        sheet.demand_numbers(LATERAL, k, values[:, k])
        axis = _AXES[position] if len(names) > 1 else _axis_of(sheet.names[k]) or "x"
        text, own_unit = column_text(sheet.column(k)), sheet.unit(k)
        if (role := next((role for role, pick in picks.items() if pick == k), None)) is not None:
            raise LogError(f"{sheet.path}: --lateral: column {text} is the {role}")
        candidates = [own_unit] if own_unit is not None else [unit, *(symbol for symbol in _UNITS if symbol != unit)]
        moving = [symbol for symbol in candidates if _MIN_WAY <= _way(values[:, k], symbol) <= _MAX_WAY]
        if not moving:
            raise LogError(
                f"{sheet.path}: --lateral: column {text} does not move like a place along the skin: from "
                f"{np.nanmin(values[:, k]):.4g} to {np.nanmax(values[:, k]):.4g} {own_unit or ''}".rstrip()
                + "; 2 mm to 0.5 m are a sweep"
            )
        if own_unit is None:
            way = 1e3 * _way(values[:, k], moving[0])
            lateral.doubts.append(f"lateral: column {text} in {moving[0]} is a guess: it goes {way:.3g} mm")
        lateral.add(axis, sheet, k, values, moving[0])
    return lateral


def _axis_of(name: str) -> str | None:
    """Return "x" or "y" where the name of a column says that it is a measured place along that axis; else None."""
    name_words = words_of(name)
    if _COMMANDED & {*name_words}:
        return None
    if (match := _ELEMENT.fullmatch(bare_name(name))) is not None:
        return _AXES[int(match[1])]
    if not name_words or is_another_quantity(name) or role_by_words(name) in ("force", "velocity"):
        return None
    return next((axis for axis in _AXES if axis in (name_words[0], name_words[-1])), None)


def _way(values: Floats, unit: str) -> float:
    """Return how far [m] a column (n,) in a unit goes in all."""
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) * si_unit(unit)[1] if len(finite) else 0.0


def _correlation(a: Floats, b: Floats) -> float:
    """Return the size of the correlation of two columns (n,); 0 where one of them is constant."""
    rows = np.isfinite(a) & np.isfinite(b)
    if np.count_nonzero(rows) < 2:
        return 0.0
    # Over their largest numbers, whose squares may overflow.
    a, b = (column[rows] / max(float(np.abs(column[rows]).max()), _TINY) for column in (a, b))
    a, b = a - a.mean(), b - b.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return abs(float(a @ b)) / size if size > 0 else 0.0


def _hints(sheet: Sheet, values: Floats, picked: Collection[int], height: Floats) -> list[str]:
    """Return a question for each column of a length, or that nothing names, that goes on steadily in the middle."""
    hints = []
    for k, name in enumerate(sheet.names):
        column = values[:, k]
        symbol = sheet.unit(k)
        is_length = symbol is not None and si_unit(symbol)[0] == "m" and _way(column, symbol) >= _MIN_WAY
        may_be_place = is_length or (symbol is None and not sheet.header)
        if k in picked or not may_be_place or _correlation(column, height) > _ALIKE:
            continue
        row = np.arange(len(column), dtype=float)
        # A place of a sweep goes on in the middle half of the record; a time, which has no unit here, in all of it.
        middle = slice(len(column) // 4, 3 * len(column) // 4)
        is_time = not is_length and _correlation(column, row) >= _TIME
        if _correlation(column[middle], row[middle]) > _STEADY and not is_time:
            hints.append(f"lateral: column {column_text(name)} goes on like a place along the skin: --lateral sets it")
    return hints
