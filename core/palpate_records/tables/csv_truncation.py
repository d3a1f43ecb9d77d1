"""Whether a table was cut within its last number."""

from __future__ import annotations

import re
from pathlib import Path

from palpate_records.tables.binary_tables import is_binary_table

_TAIL = 1 << 16  # [bytes] that are looked into
_LINES = 100  # before the last one, of which none is as short by chance: one table in a hundred, where digits vary
_NUMBER = re.compile(r"[+-]?(\d*)(?:\.(\d*))?(?:[eE][+-]?(\d+))?")


def cut_number(path: Path, delimiter: str, decimal: str = ".") -> str | None:
    """Return the last number of a file, if its line has no end and all numbers above it have more digits.

    Digits of the exponent, else behind the point, else of whole numbers: of a number that was cut, those that matter
    are the first to go. Tables written by hand often have no last end of line; a file that was packed is whole.
    """
    if path.suffix.lower() == ".gz" or is_binary_table(path):
        return None
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(size - 1, 0))
        if file.read() in b"\r\n":
            return None
        file.seek(max(size - _TAIL, 0))
        text = file.read().decode(errors="replace")
    if "\0" in text:  # UTF-16
        return None
    text = text.replace(",", ".") if decimal == "," else text
    *above, last = text.splitlines() or [""]
    if '"' in text:
        return None
    cells = [line.split(delimiter) for line in above[size > _TAIL :]]
    width, cell = last.count(delimiter) + 1, last.split(delimiter)[-1].strip()
    others = [shape for row in cells if len(row) == width and (shape := _shape(row[-1].strip()))]
    mine = _shape(cell)
    if mine is None or len(others) < _LINES:
        return None
    whole, point, exponent = (min(digits) for digits in zip(*others, strict=True))
    if mine[2] < exponent:
        return cell
    of_whole_numbers = not any(decimals or power for _, decimals, power in others)
    shorter = mine[1] < point or (of_whole_numbers and mine[0] < whole)
    return cell if shorter and not mine[2] else None


def _shape(cell: str) -> tuple[int, int, int] | None:
    """Return how many digits a number has before the point, behind it and in its exponent."""
    found = _NUMBER.fullmatch(cell)
    return (len(found[1]), len(found[2] or ""), len(found[3] or "")) if found and cell else None
