"""Numbers without a unit that were hardly meant: 4 for 4 mm is 4 m."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import UnionType
from typing import Any, Union, get_args, get_origin

from palpate.parts import Settings
from palpate.units import Quantity

UNCHECKED = "unchecked"  # key of any table: names of keys whose numbers are meant as they are


def quantity_of(annotation: Any, metadata: Sequence[Any] = ()) -> Quantity | None:
    """Return the quantity that a field holds, alone, as an alternative or in a list; None where it holds none."""
    quantity = next((item for item in metadata if isinstance(item, Quantity)), None)
    if quantity is not None:
        return quantity
    if hasattr(annotation, "__metadata__"):
        return quantity_of(annotation.__origin__, annotation.__metadata__)
    if get_origin(annotation) in (Union, UnionType, tuple):
        return next((q for q in map(quantity_of, get_args(annotation)) if q is not None), None)
    return None


def implausible_units(settings: type[Settings], table: Mapping[str, Any]) -> dict[str, str]:
    """Return what is doubted of a table's numbers without a unit, by key."""
    doubts = {}
    for name in settings.model_fields.keys() & table.keys():
        field = settings.model_fields[name]
        if (quantity := quantity_of(field.annotation, field.metadata)) is None:
            continue
        items = table[name] if isinstance(table[name], list | tuple) else [table[name]]
        numbers = [item for item in items if isinstance(item, int | float) and not isinstance(item, bool)]
        if doubt := next(filter(None, map(quantity.doubt, numbers)), ""):
            doubts[name] = doubt
    return doubts
