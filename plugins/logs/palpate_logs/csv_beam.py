"""Stage and deflection: a length over which the force is one constant is what a beam or spring yields by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from palpate import Floats
from palpate_kit.logs.role_guess import NumberColumn
from palpate_records.messages.readings import LARGEST, si_unit

_READINGS, _SPRING = 20, 1e-5  # readings; share of a force's variance that one constant leaves


def deflections(series: Sequence[NumberColumn]) -> list[NumberColumn]:
    """Lengths of several over which the force is one constant from first to last: a beam or spring, and no position."""
    forces, places = ([s for s in series if s.role == role] for role in ("force", "position"))
    lengths = [s for s in series if s in places or (s.role == "other" and s.unit and si_unit(s.unit)[0] == "m")]
    found = [s for s in lengths if any(_is_spring(s.values, force.values) for force in forces)]
    return found if any(s not in found for s in places) else []


def _is_spring(length: Floats, force: Floats) -> bool:
    known = (np.abs(length) < LARGEST) & (np.abs(force) < LARGEST)
    x, y = length[known], force[known]
    if len(x) < _READINGS or not float(np.ptp(x)) > 0.0 or not float(np.ptp(y)) > 0.0:
        return False
    return 1.0 - float(np.corrcoef(x, y)[0, 1]) ** 2 < _SPRING


def stiffness_of(length: Floats, force: Floats) -> float:
    """Return the size of the constant that is the force over a length, as recorded."""
    known = (np.abs(length) < LARGEST) & (np.abs(force) < LARGEST)
    return abs(float(np.polyfit(length[known], force[known], 1)[0]))


def which_of_both(bent: NumberColumn, place: NumberColumn) -> str:
    """What is asked about a length next to a deflection."""
    name, stage = (one.label.removeprefix("column ") for one in (bent, place))
    return (
        f"the force is one constant times {name}, which is what a beam or spring yields by: is {stage} that of "
        "the stage behind it (stage), or of the tip, with that taken off already (tip)"
    )
