"""Numbers and texts of a report, as readers see them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from palpate_engine import display_unit, is_open, verdict_word
from palpate_kit.terminal.quantities import FIXED, is_fixed, value_with_uncertainty


def number_text(value: float, unit: str) -> str:
    """A number in display units.

    >>> number_text(1772.66, "Pa")
    '1.77 kPa'
    """
    word, factor = display_unit(unit)
    return f"{value * factor:.3g} {word}".removesuffix(" 1").rstrip()


def value_of(found: Mapping[str, Any]) -> str:
    """A value with its combined standard uncertainty and unit; or why it has none, or a dash.

    >>> value_of({"value": 112836.1, "combined": 1772.7, "unit": "Pa"})
    '112.8 ± 1.8 kPa'
    """
    verdict = found.get("verdict") or ""
    if found["value"] is None or verdict == "invalid":
        return verdict if is_open(verdict) else "–"
    word, factor = display_unit(found["unit"])
    combined = found.get("combined")
    number = value_with_uncertainty(found["value"] * factor, math.nan if combined is None else combined * factor)
    text = f"{number} {word}".removesuffix(" 1") + (FIXED if is_fixed(found["value"], combined) else "")
    return f"{text} {verdict_word(verdict)}".rstrip()


def parts_of(found: Mapping[str, Any]) -> str:
    """What the combined uncertainty is made of, in short."""
    names = {"std": "estimator", "settling": "settling", "systematic": "systematic"}
    known = [f"{word} {number_text(found[key], found['unit'])}" for key, word in names.items() if found.get(key)]
    return ", ".join(known)


def readable(name: str) -> str:
    """A key of the result as words.

    >>> readable("relaxation_time")
    'relaxation time'
    """
    return name.replace("_", " ")


def plain(value: Any) -> str:
    """Any plain value of the result in one cell."""
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


def chance(p: float | None) -> str:
    """A p-value.

    >>> chance(1e-120)
    '< 1e-99'
    """
    if p is None:
        return "–"
    return "< 1e-99" if p < 1e-99 else f"{p:.2g}"


def embed_json(document: Any, indent: int | None = 1) -> str:
    """A document as JSON that may stand within a page's script element, whatever texts are in it."""
    text = json.dumps(document, indent=indent, allow_nan=False, ensure_ascii=True)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return text
