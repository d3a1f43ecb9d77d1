"""Table of a specimen in a pipeline file: the paper's specimen of its name, and parameters next to the model."""

from __future__ import annotations

from collections.abc import Container
from typing import Any

from palpate import Quantity, to_si

from palpate_simulation.paper_specimens import SPECIMENS


class _PlainNumber(float):
    """A number next to the model without a unit, as a person writes it."""


def gather_parameters(table: dict[str, Any], keys: Container[str]) -> dict[str, Any]:
    """Return a specimen's table in which the entries that are not keys of a specimen are its `parameters`.

    Those of the paper's specimen of its name come first. A table that has `parameters` is left as it is.
    """
    table = _complete_by_name(table, keys)
    if "parameters" in table:
        return table
    settings: dict[str, Any] = {}
    parameters: dict[str, Any] = {}
    for key, entry in table.items():
        if key in keys:
            settings[key] = entry
        else:
            parameters[key] = _mark_plain(entry)
    return settings | {"parameters": parameters}


def parameter_in_si(name: str, entry: Any, unit: str) -> float:
    """Return a parameter in its SI unit; raises ValueError for another unit, or a plain number that may lack one."""
    if isinstance(entry, _PlainNumber) and (doubt := Quantity(unit).doubt(entry)):
        raise ValueError(f"{name}: {doubt}")
    try:
        return to_si(entry, unit)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error


def _complete_by_name(table: dict[str, Any], keys: Container[str]) -> dict[str, Any]:
    """Return a specimen's table, completed from the paper's specimen of its name."""
    defaults = dict(SPECIMENS.get(str(table.get("name")), {}))
    if "parameters" in table:
        defaults = {key: entry for key, entry in defaults.items() if key in keys}
    if "size" in table:
        defaults.pop("diameter", None)
    return defaults | table


def _mark_plain(entry: Any) -> Any:
    """Return a number as one without a unit, anything else as it is."""
    return _PlainNumber(entry) if isinstance(entry, int | float) and not isinstance(entry, bool) else entry
