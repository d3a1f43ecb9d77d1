"""The columns of a table with the place of the tip along the skin: by their names, or as a person states."""

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
_POSE_ELEMENT = re.compile(r".*pose[_.\[]([01])\]?")  # index of x or y: actual_TCP_pose_0
_COMMAND_WORDS = {"target", "desired", "setpoint", "command", "commanded", "reference", "goal"}
_MIN_SWEEP = 2e-3  # [m] from which on a record is a sweep: that of the result (decision 0127)
_MAX_SWEEP = 0.5  # [m], a choice: what an arm palpates in one record
_MIN_HEIGHT_CORRELATION = 0.98  # from which on a column is the height again: a choice
_MIN_PLACE_CORRELATION = 0.99  # with the row, from which on a column may be the place along a sweep: a choice
_MIN_TIME_CORRELATION = 0.9999  # with the row, from which on a column is a time: a choice
_SPEED_STEP = 0.2  # [s] between places, a choice: their noise does not count in it
_FAST_QUANTILE = 0.9  # of the speeds, a choice: the fastest tenth is certainly of a tip that moves on
_MIN_SPEED_SHARE = 0.5  # of that speed, from which on the tip moves on: a choice
_TINY = 1e-300  # keeps the largest number of a column of zeros above 0
_UNITS = ("mm", "m", "um")  # that a column without a unit may have


@dataclass
class LateralColumns:
    """The columns of x and y, and what is not certain about them."""

    columns: dict[str, dict[str, Any]] = field(default_factory=dict)  # by axis
    places: list[Floats] = field(default_factory=list)  # (n,) [m] of each of them
    doubts: list[str] = field(default_factory=list)
    hints: list[str] = field(default_factory=list)

    def add(self, axis: str, column: int | str, values: Floats, unit: str) -> None:
        """Add a column, as a pipeline names it, with its values (n,) in a unit as the place along an axis."""
        self.columns[axis] = {"column": column, "unit": unit}
        self.places.append(values * si_unit(unit)[1])

    def speed(self, time: Floats) -> float:
        """Return the speed [m/s] along the skin at times (n,) [s] while the tip moves on; NaN where it never does.

        It is the median of the speeds, over steps of 0.2 s, that reach half the 90 % quantile of all.
        """
        places = np.column_stack(self.places)
        finite_rows = np.flatnonzero(np.isfinite(places).all(axis=1))
        stride = max(round(_SPEED_STEP / float(np.median(np.diff(time)))), 1)  # [rows]
        rows = finite_rows[::stride]
        speeds = np.linalg.norm(np.diff(places[rows], axis=0), axis=1) / np.diff(time[rows])
        if not len(speeds):
            return math.nan
        min_speed = _MIN_SPEED_SHARE * np.quantile(speeds, _FAST_QUANTILE)
        return float(np.median(speeds[speeds >= min_speed]))


def lateral_columns(
    sheet: Sheet, values: Floats, picks: Mapping[str, int], unit: str, stated: str | None
) -> LateralColumns:
    """Return the lateral columns of a sheet with values (n, columns): those that a person states, else those by name.

    `picks` are the columns of force and motion by role, `unit` is that of the position. By name are columns x or y, or
    elements of a pose, that go 2 mm and more and are not the height again; none that differs from a force or a velocity
    by its axis alone. Without one, a hint asks of each column that moves like a place. Raises LogError for a stated
    column that is missing, or does not move like a place.
    """
    if stated is not None:
        return _stated_columns(sheet, values, picks, unit, stated)
    lateral = LateralColumns()
    height = values[:, picks["position"]]
    vector_stems = {sheet.names[index][:-1] for role, index in picks.items() if role != "position"} - {""}
    for index, name in enumerate(sheet.names):
        # "Fx" next to a force "Fz" is another axis of that.
        if index in picks.values() or name[:-1] in vector_stems:
            continue
        axis = _lateral_axis(name)
        column_values = values[:, index]
        if axis is None or axis in lateral.columns:
            continue
        if _correlation(column_values, height) > _MIN_HEIGHT_CORRELATION:
            continue
        column_unit = sheet.unit(index) or unit
        if si_unit(column_unit)[0] == "m" and _range(column_values, column_unit) >= _MIN_SWEEP:
            lateral.add(axis, sheet.column(index), column_values, column_unit)
    if not lateral.columns:
        lateral.hints += _hints(sheet, values, picks.values(), height)
    return lateral


def _stated_columns(sheet: Sheet, values: Floats, picks: Mapping[str, int], unit: str, stated: str) -> LateralColumns:
    """Return the columns that a person states by names or numbers, as "COLUMN" or "X_COLUMN,Y_COLUMN".

    `picks` are the columns of force and motion by role, `unit` is that of the position. Raises LogError for a column
    that has another role, or does not move like a place.
    """
    references = [reference.strip() for reference in stated.split(",")]
    if len(references) > len(_AXES):
        raise LogError(f"{sheet.path}: --lateral: {len(references)} columns; name one, or that of x and that of y")
    lateral = LateralColumns()
    for reference, order_axis in zip(references, _AXES, strict=False):
        index = sheet.index_of(LATERAL, reference)
        column_values = values[:, index]
        sheet.demand_numbers(LATERAL, index, column_values)
        axis = order_axis if len(references) > 1 else _lateral_axis(sheet.names[index]) or "x"
        label = column_text(sheet.column(index))
        role = next((role for role, pick in picks.items() if pick == index), None)
        if role is not None:
            raise LogError(f"{sheet.path}: --lateral: column {label} is the {role}")
        place_unit = _place_unit(sheet, index, column_values, unit)
        if sheet.unit(index) is None:
            sweep_mm = 1e3 * _range(column_values, place_unit)
            lateral.doubts.append(f"lateral: column {label} in {place_unit} is a guess: it goes {sweep_mm:.3g} mm")
        lateral.add(axis, sheet.column(index), column_values, place_unit)
    return lateral


def _place_unit(sheet: Sheet, index: int, values: Floats, position_unit: str) -> str:
    """Return the unit in which the values (n,) of a column go as far as a sweep does.

    It is that of the column, else that of the position, else a usual one. Raises LogError if the column goes as far as
    a sweep in none of them.
    """
    column_unit = sheet.unit(index)
    candidates = [column_unit]
    if column_unit is None:
        candidates = [position_unit, *(unit for unit in _UNITS if unit != position_unit)]
    for candidate in candidates:
        if candidate is not None and _MIN_SWEEP <= _range(values, candidate) <= _MAX_SWEEP:
            return candidate
    label = column_text(sheet.column(index))
    raise LogError(
        f"{sheet.path}: --lateral: column {label} does not move like a place along the skin: "
        f"from {np.nanmin(values):.4g} to {np.nanmax(values):.4g} {column_unit or ''}".rstrip()
        + "; 2 mm to 0.5 m are a sweep"
    )


def _lateral_axis(name: str) -> str | None:
    """Return "x" or "y" if the name of a column states a measured place along that axis, else None."""
    name_words = words_of(name)
    if _COMMAND_WORDS & {*name_words}:
        return None
    if (match := _POSE_ELEMENT.fullmatch(bare_name(name))) is not None:
        return _AXES[int(match[1])]
    if not name_words or is_another_quantity(name) or role_by_words(name) in ("force", "velocity"):
        return None
    return next((axis for axis in _AXES if axis in (name_words[0], name_words[-1])), None)


def _range(values: Floats, unit: str) -> float:
    """Return the largest minus the smallest finite value [m] of a column (n,) in a unit of length."""
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) * si_unit(unit)[1] if len(finite) else 0.0


def _correlation(a: Floats, b: Floats) -> float:
    """Return |r|, the magnitude of the correlation of two columns (n,); 0 if one of them is constant."""
    rows = np.isfinite(a) & np.isfinite(b)
    if np.count_nonzero(rows) < 2:
        return 0.0
    x, y = _centred(a[rows]), _centred(b[rows])
    norm_product = float(np.sqrt((x @ x) * (y @ y)))
    return abs(float(x @ y)) / norm_product if norm_product > 0 else 0.0


def _centred(values: Floats) -> Floats:
    """Return values (n,) over the largest magnitude, whose square may overflow, minus their mean."""
    scaled: Floats = values / max(float(np.abs(values).max()), _TINY)
    centred: Floats = scaled - scaled.mean()
    return centred


def _hints(sheet: Sheet, values: Floats, picked: Collection[int], height: Floats) -> list[str]:
    """Return a hint on each column that goes on steadily in the middle half of the record.

    It is in a unit of length, or has neither unit nor name; `picked` are the columns that have a role, `height` (n,) is
    one of them, which a lateral column does not repeat.
    """
    hints = []
    for index, name in enumerate(sheet.names):
        column = values[:, index]
        unit = sheet.unit(index)
        is_length = unit is not None and si_unit(unit)[0] == "m" and _range(column, unit) >= _MIN_SWEEP
        may_be_place = is_length or (unit is None and not sheet.header)
        if index in picked or not may_be_place or _correlation(column, height) > _MIN_HEIGHT_CORRELATION:
            continue
        row = np.arange(len(column), dtype=float)
        # A place of a sweep goes on in the middle half of the record; a time, which has no unit here, in all of it.
        middle = slice(len(column) // 4, 3 * len(column) // 4)
        is_time = not is_length and _correlation(column, row) >= _MIN_TIME_CORRELATION
        if _correlation(column[middle], row[middle]) > _MIN_PLACE_CORRELATION and not is_time:
            hints.append(f"lateral: column {column_text(name)} goes on like a place along the skin: --lateral sets it")
    return hints
