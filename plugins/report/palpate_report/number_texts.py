"""Numbers and texts of a report, as readers see them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from palpate_engine import display_unit, is_open
from palpate_kit.runs.document_table import table_value


def number_text(value: float, unit: str) -> str:
    """Return a number in display units.

    >>> number_text(1772.66, "Pa")
    '1.77 kPa'
    """
    symbol, factor = display_unit(unit)
    return f"{value * factor:.3g} {symbol}".removesuffix(" 1").rstrip()


def value_of(table: Mapping[str, Any]) -> str:
    """Return a value with its combined standard uncertainty and unit; or why it has none, or a dash.

    >>> value_of({"value": 112836.1, "combined": 1772.7, "unit": "Pa"})
    '112.8 ± 1.8 kPa'
    """
    value = replace(table_value("", table, ""), places={})
    return value.text if value.number != "-" else value.verdict if is_open(value.verdict) else "–"


def range_of(value: Mapping[str, Any]) -> str:
    """Return a value as on every screen: along a path its range and mean with its verdict.

    >>> places = {"low": 110e3, "high": 150e3, "spread": 8.9e3}
    >>> range_of({"value": 120e3, "combined": 9e3, "unit": "Pa", "verdict": "good", "places": places})
    '110 to 150, mean 120.0 ± 1.3 kPa good'
    """
    return table_value("", value, "").text if value.get("places") else value_of(value)


def parts_of(value: Mapping[str, Any]) -> str:
    """Return the parts of the combined uncertainty, in short."""
    names = {"std": "estimator", "settling": "settling", "systematic": "systematic"}
    present = [(key, name) for key, name in names.items() if value.get(key)]
    return ", ".join(f"{name} {number_text(value[key], value['unit'])}" for key, name in present)


def readable(name: str) -> str:
    """Return a key of the result as words.

    >>> readable("relaxation_time")
    'relaxation time'
    """
    return name.replace("_", " ")


def plain(value: Any) -> str:
    """Return any plain value of the result as the text of a cell."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return ", ".join(plain(item) for item in value)
    if isinstance(value, dict):
        return "; ".join(f"{readable(str(key))}: {plain(item)}" for key, item in value.items())
    return str(value)


def embed_json(document: Any, indent: int | None = 1) -> str:
    """Return a document as JSON that may stand within a page's script element, whatever texts are in it."""
    text = json.dumps(document, indent=indent, allow_nan=False, ensure_ascii=True)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return text
