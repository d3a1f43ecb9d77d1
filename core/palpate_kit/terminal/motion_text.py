"""The motion that records measured in a few words, as in "2 Hz, 2.2 to 4.3 mm deep"."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from palpate_kit.terminal.phrase import Phrase, Quantity, curve_count, merged_phrases, phrase_text, quantity_text

Numbers = Mapping[str, float]  # `frequency` or `speed`, `shallowest`, `deepest`, `half_space_from` of a record [SI]
MOTION_COLUMNS = ("frequency", "speed", "shallowest", "deepest", "half_space_from")  # columns of a row of fits


def row_motion(row: Mapping[str, str]) -> dict[str, float]:
    """Return the numbers of the motion of a row of fits; empty where it has none."""
    return {name: float(row[name]) for name in MOTION_COLUMNS if row.get(name)}


def motion_numbers(table: Mapping[str, Any]) -> dict[str, float]:
    """Return the numbers of the diagnosis `motion` of a track by the columns of a row [SI]."""
    depth = dict(zip(("shallowest", "deepest"), table.get("depth", ()), strict=False))
    return {key: float(number) for key, number in {**table, **depth}.items() if key in MOTION_COLUMNS}


def motion_text(motions: Sequence[Numbers]) -> str:
    """Return kind, rate and depths of the motions of some records, by their ranges; empty without any."""
    known_motions = [motion for motion in motions if "deepest" in motion]
    if not known_motions:
        return ""
    groups = merged_phrases((_rate_phrase(motion), 1) for motion in known_motions)
    texts = [phrase_text(phrases, quantity_text) for phrases, _ in groups]
    if len(groups) > 1:
        texts = [f"{text} ({curve_count(count)})" for text, (_, count) in zip(texts, groups, strict=True)]
    shallowest = min(motion["shallowest"] for motion in known_motions)
    deepest = max(motion["deepest"] for motion in known_motions)
    depths = _interval_text(shallowest, deepest)
    return f"{' or '.join(texts)}, {depths} deep"


def layer_limit(motions: Sequence[Numbers]) -> str:
    """Return the thickness above which a stated half-space holds for every record; empty if none is stated.

    Above it a bonded layer moves the elasticity of no record by more than its uncertainty.
    """
    limits = [motion["half_space_from"] for motion in motions if "half_space_from" in motion]
    return f"above {_length_text(max(limits))} thick" if limits else ""


def measured_text(motions: Sequence[Numbers]) -> str:
    """Return the motions, and the thickness above which a stated half-space holds."""
    limit = layer_limit(motions)
    return "; ".join(filter(None, [motion_text(motions), f"half-space: {limit}" if limit else ""]))


def _rate_phrase(motion: Numbers) -> Phrase:
    """Return the frequency of an oscillation, the speed of a press, or "in contact" without either."""
    if "frequency" in motion:
        return (_rounded(motion["frequency"], "Hz"),)
    return ("press ", _rounded(motion["speed"], "m/s")) if "speed" in motion else ("in contact",)


def _rounded(value: float, unit: str) -> Quantity:
    """Return a quantity of two digits, which are enough to describe a motion, without a power of ten."""
    return Quantity(float(f"{value:.2g}"), unit)


def _length_text(length: float) -> str:
    """Return a length [m] to two digits, with its unit."""
    return quantity_text(_rounded(length, "m"))


def _interval_text(low: float, high: float) -> str:
    """Return two lengths [m], with one unit if they share it.

    >>> _interval_text(2.2e-3, 4.31e-3), _interval_text(0.0, 2e-6), _interval_text(5e-5, 1e-3)
    ('2.2 to 4.3 mm', '0 to 2 um', '50 um to 1 mm')
    """
    low_text, high_text = _length_text(low), _length_text(high)
    number, _, unit = low_text.partition(" ")
    return f"{number if not low or unit == high_text.partition(' ')[2] else low_text} to {high_text}"
