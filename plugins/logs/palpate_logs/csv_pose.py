"""Columns in addition to those of force and height: a force's other axes, a pose, the place of a record."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from palpate import Floats
from palpate_kit.logs import stated_roles
from palpate_kit.logs.role_evidence import span_of
from palpate_kit.logs.role_guess import RoleGuess
from palpate_records.messages.readings import si_unit
from palpate_records.tables.csv_names import bare_name, words_of
from palpate_records.tables.csv_sheet import Sheet

_ELEMENT = re.compile(r"(.*?)[_.\[]([0-9])\]?")  # of an array: actual_TCP_force_2, wrench[2]
_UNITY = 0.01  # by which a quaternion's length may miss one


def with_axes(
    columns: Mapping[str, Mapping[str, Any]], found: RoleGuess, sheet: Sheet, values: Floats
) -> dict[str, dict[str, Any]]:
    """Return the columns by role, each after those that belong to it, as the axes of a signal are read in their order.

    `values` (n, columns) are the numbers of the sheet: a quaternion has the length one.
    """
    names = list(map(bare_name, sheet.names))
    every: dict[str, dict[str, Any]] = {}
    for role, column in columns.items():
        name = names[int(found.picks[role].series.key[1])]
        beside = [(key, names.index(other), unit) for key, other, unit in stated_roles.beside(role, name, names)]
        quaternion = [k for key, k, _ in beside if key.startswith("q")]
        if not quaternion or _is_unit_length(values[:, quaternion]):
            for key, k, unit in beside:
                own_unit = (None if unit == "1" else sheet.unit(k)) or unit or column["unit"]
                scale = {"scale": column["scale"]} if "scale" in column and own_unit == column["unit"] else {}
                every[key] = {"column": sheet.column(k), "unit": own_unit, **scale}
        every[role] = dict(column)
    return every


def sideways_forces(names: Sequence[str], roles: Sequence[str | None], values: Floats) -> set[int]:
    """Of three columns that are the axes of a force, the two whose readings (n, columns) change less."""
    bare = list(map(bare_name, names))
    found: set[int] = set()
    for k, name in enumerate(bare):
        beside = [bare.index(other) for _, other, _ in stated_roles.beside("force", name, bare)]
        if beside and roles[k] == "force":
            span = {axis: span_of(values[:, axis]) for axis in (*beside, k)}
            found |= {*span} - {max(span, key=span.__getitem__)}
    return found


def turning_elements(names: Sequence[str]) -> set[int]:
    """Return the columns that are elements 3 to 5 of six: torques of a wrench, angles of a pose, and joints."""
    elements: dict[str, dict[int, int]] = {}
    for k, name in enumerate(names):
        if (match := _ELEMENT.fullmatch(name.strip())) is not None:
            elements.setdefault(match[1], {})[int(match[2])] = k
    return {k for six in elements.values() if {*six} == {*range(6)} for index, k in six.items() if index > 2}


def _is_unit_length(quaternions: Floats) -> bool:
    lengths = np.linalg.norm(quaternions, axis=1)
    return bool(np.isfinite(lengths).any()) and abs(float(np.nanmedian(lengths)) - 1.0) < _UNITY


def places_of(sheet: Sheet) -> dict[str, dict[str, Any]]:
    """Return the columns that say where along the skin a record is; none where one of the two is missing."""
    found: dict[str, dict[str, Any]] = {}
    for k, name in enumerate(sheet.names):
        unit, words = sheet.unit(k), words_of(name)
        if words and words[0] in ("x", "y") and unit and si_unit(unit)[0] == "m":
            found.setdefault(words[0], {"column": sheet.column(k), "unit": unit})
    return found if len(found) == 2 else {}
