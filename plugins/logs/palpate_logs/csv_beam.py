"""Stage and deflection: a length over which the force is one constant is what a beam or spring yields by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from palpate import Floats
from palpate_kit.logs.role_guess import NumberColumn
from palpate_records.messages.readings import LARGEST, si_unit

_MIN_READINGS = 20  # over which a correlation counts, a choice
_MAX_RESIDUAL_SHARE = 1e-5  # of a force's variance that a line over the length leaves, a choice: a computed column


def deflections(series: Sequence[NumberColumn]) -> list[NumberColumn]:
    """Return the columns by which a beam or spring yields: lengths over which a force is one constant throughout.

    Empty if no other length is left for the position.
    """
    forces = [column for column in series if column.role == "force"]
    bends: list[NumberColumn] = []
    has_height = False
    for column in series:
        is_height = column.role == "position"
        if not is_height and not (column.role == "other" and _is_length(column)):
            continue
        if any(_is_spring(column.values, force.values) for force in forces):
            bends.append(column)
        elif is_height:
            has_height = True
    return bends if has_height else []


def _is_length(column: NumberColumn) -> bool:
    """Return True for a column in a unit of length."""
    return bool(column.unit) and si_unit(column.unit)[0] == "m"


def _is_spring(length: Floats, force: Floats) -> bool:
    """Return True if a force (n,) is a straight line over a length (n,): 1 - r^2 of their correlation r is tiny."""
    is_reading = (np.abs(length) < LARGEST) & (np.abs(force) < LARGEST)
    x, y = length[is_reading], force[is_reading]
    if len(x) < _MIN_READINGS or not float(np.ptp(x)) > 0.0 or not float(np.ptp(y)) > 0.0:
        return False
    return 1.0 - float(np.corrcoef(x, y)[0, 1]) ** 2 < _MAX_RESIDUAL_SHARE


def spring_constant(length: Floats, force: Floats) -> float:
    """Return the magnitude of the slope of a force (n,) over a length (n,), as recorded."""
    is_reading = (np.abs(length) < LARGEST) & (np.abs(force) < LARGEST)
    return abs(float(np.polyfit(length[is_reading], force[is_reading], 1)[0]))


def stage_question(deflection: NumberColumn, position: NumberColumn) -> str:
    """Return the question of a position next to a deflection: is it that of the stage, or of the tip?"""
    deflection_name = deflection.label.removeprefix("column ")
    position_name = position.label.removeprefix("column ")
    return (
        f"the force is one constant times {deflection_name}, which is what a beam or spring yields by: is "
        f"{position_name} that of the stage behind it (stage), or of the tip, with that taken off already (tip)"
    )
