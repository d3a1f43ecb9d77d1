"""Columns in addition to those of force and height: a force's other axes, a pose, the place of a record."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from palpate import Floats
from palpate_kit.logs.role_evidence import span_of
from palpate_kit.logs.role_guess import RoleGuess
from palpate_kit.logs.stated_roles import beside
from palpate_records.messages.readings import si_unit
from palpate_records.tables.csv_names import bare_name, words_of
from palpate_records.tables.csv_sheet import Sheet

_ELEMENT = re.compile(r"(.*?)[_.\[]([0-9])\]?")  # stem and index of an array's element: actual_TCP_force_2, wrench[2]
_WRENCH_INDICES = range(6)  # three of forces or places, then three of torques or angles
_QUATERNION_TOLERANCE = 0.01  # by which the length of a quaternion may miss one, a choice: tables round its elements


def with_axes(
    columns: Mapping[str, Mapping[str, Any]], guess: RoleGuess, sheet: Sheet, values: Floats
) -> dict[str, dict[str, Any]]:
    """Return the settings of columns by channel: those of each role, behind the other axes of its force or pose.

    The axes of a signal are read in this order. `columns` are the settings by role, `values` (n, columns) the numbers
    of the sheet; four columns are a quaternion only if they have the length one.
    """
    names = [bare_name(name) for name in sheet.names]
    channels: dict[str, dict[str, Any]] = {}
    for role, column in columns.items():
        role_name = names[int(guess.picks[role].series.key[1])]
        axes = [(channel, names.index(name), unit) for channel, name, unit in beside(role, role_name, names)]
        quaternion = [index for channel, index, _ in axes if channel.startswith("q")]
        if not quaternion or _is_unit_length(values[:, quaternion]):
            for channel, index, unit in axes:
                channels[channel] = _axis_settings(sheet, index, unit, column)
        channels[role] = dict(column)
    return channels


def _axis_settings(sheet: Sheet, index: int, unit: str | None, role_column: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of the column of an axis: its unit, else `unit`, else that of the role's column.

    `unit` is "1" for an element of a quaternion. The scale of the role's column counts if the units are the same.
    """
    axis_unit = (None if unit == "1" else sheet.unit(index)) or unit or role_column["unit"]
    settings = {"column": sheet.column(index), "unit": axis_unit}
    if "scale" in role_column and axis_unit == role_column["unit"]:
        settings["scale"] = role_column["scale"]
    return settings


def sideways_forces(names: Sequence[str], roles: Sequence[str | None], values: Floats) -> set[int]:
    """Return the columns of the two axes of each force, of three, whose readings (n, columns) change less."""
    bare_names = [bare_name(name) for name in names]
    sideways: set[int] = set()
    for index, name in enumerate(bare_names):
        other_axes = [bare_names.index(axis) for _, axis, _ in beside("force", name, bare_names)]
        if other_axes and roles[index] == "force":
            spans = {axis: span_of(values[:, axis]) for axis in (*other_axes, index)}
            pressing_axis = max(spans, key=spans.__getitem__)
            sideways |= {*spans} - {pressing_axis}
    return sideways


def turning_elements(names: Sequence[str]) -> set[int]:
    """Return the columns that are elements 3 to 5 of six: torques of a wrench, angles of a pose, and joints."""
    columns_by_stem: dict[str, dict[int, int]] = {}  # of an array: its columns by the index of the element
    for column, name in enumerate(names):
        match = _ELEMENT.fullmatch(name.strip())
        if match is not None:
            columns_by_stem.setdefault(match[1], {})[int(match[2])] = column
    arrays = [columns for columns in columns_by_stem.values() if {*columns} == {*_WRENCH_INDICES}]
    return {columns[index] for columns in arrays for index in _WRENCH_INDICES[3:]}


def _is_unit_length(quaternions: Floats) -> bool:
    """Return True for rows of four numbers (n, 4) whose median length is one."""
    lengths = np.linalg.norm(quaternions, axis=1)
    return bool(np.isfinite(lengths).any()) and abs(float(np.nanmedian(lengths)) - 1.0) < _QUATERNION_TOLERANCE


def place_columns(sheet: Sheet) -> dict[str, dict[str, Any]]:
    """Return the settings of the columns x and y that state where along the skin a record is; empty without both."""
    places: dict[str, dict[str, Any]] = {}
    for index, name in enumerate(sheet.names):
        unit, name_words = sheet.unit(index), words_of(name)
        if name_words and name_words[0] in ("x", "y") and unit and si_unit(unit)[0] == "m":
            places.setdefault(name_words[0], {"column": sheet.column(index), "unit": unit})
    return places if len(places) == 2 else {}
