"""A phrase with quantities: phrases of many curves that differ in their numbers alone become one, with ranges."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

# Display units with their factors, by SI unit.
_DISPLAY_UNITS = {"kg": ("g", 1e3), "s": ("ms", 1e3), "rad": ("deg", math.degrees(1.0))}
_SMALL_LENGTH, _SMALL_SPEED = 1e-4, 1e-5  # [m], [m/s] below which they are written with um: a choice


@dataclass(frozen=True)
class Quantity:
    """A number of a phrase [SI], and its unit: it is written in the one that a reader expects."""

    value: float
    unit: str = "1"
    digits: int = 4


Phrase = tuple[str | Quantity, ...]


def phrase_text(phrases: Sequence[Phrase], write: Callable[[Quantity], str]) -> str:
    """Return the text of phrases that differ in their numbers only: two as in "3 or 5 mm", more as in "10 to 22 mm"."""
    return "".join(
        part if isinstance(part, str) else _range([phrase[place] for phrase in phrases], write)
        for place, part in enumerate(phrases[0])
    )


def _range(quantities: Sequence[str | Quantity], write: Callable[[Quantity], str]) -> str:
    """Return the quantities of one place of several phrases: one, two as in "3 or 5 mm", more by their range."""
    numbers = sorted(
        (quantity for quantity in quantities if isinstance(quantity, Quantity)), key=lambda quantity: quantity.value
    )
    texts = list(dict.fromkeys(map(write, numbers)))
    if len(texts) == 1:
        return texts[0]
    number, _, unit = texts[0].rpartition(" ")
    low_text = number if number and unit == texts[-1].rpartition(" ")[2] else texts[0]
    return f"{low_text} {'or' if len(texts) == 2 else 'to'} {texts[-1]}"


def merged_phrases(counted: Iterable[tuple[Phrase, int]]) -> list[tuple[list[Phrase], int]]:
    """Return phrases in groups that differ in their numbers only, each with its number of curves, the most first."""
    groups: dict[tuple[str, ...], tuple[list[Phrase], list[int]]] = {}
    for phrase, count in counted:
        # The phrase without its numbers, whose units stand behind a character that no text has.
        pattern = tuple(part if isinstance(part, str) else f"\0{part.unit}" for part in phrase)
        phrases, counts = groups.setdefault(pattern, ([], []))
        phrases.append(phrase)
        counts.append(count)
    return sorted(((phrases, sum(counts)) for phrases, counts in groups.values()), key=lambda group: -group[1])


def curve_count(count: int) -> str:
    """Return "1 curve", "2 curves"."""
    return f"{count} curve{'' if count == 1 else 's'}"


def quantity_text(quantity: Quantity) -> str:
    """Return a length or a speed with mm or um, a mass in g, a time in ms, an angle in degrees, others in SI units."""
    value, unit = quantity.value, quantity.unit
    if unit in ("m", "m/s"):
        is_small = 0 < abs(value) < (_SMALL_LENGTH if unit == "m" else _SMALL_SPEED)
        unit, factor = (f"u{unit}", 1e6) if is_small else (f"m{unit}", 1e3)
    else:
        unit, factor = _DISPLAY_UNITS.get(unit, (unit, 1.0))
    return f"{value * factor:.{quantity.digits}g}" + ("" if unit == "1" else f" {unit}")
