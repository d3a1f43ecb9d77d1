"""The text of an instrument's table: its encoding, what separates its cells, and the numbers in them."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from palpate import LogError
from palpate_kit.logs.log_files import readable, regular

_LARGEST = 50_000_000  # [bytes]
_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
_SEPARATORS = ("\t", ";", ",", " ")
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf(?:inity)?)", re.IGNORECASE)


@dataclass(frozen=True)
class TextLine:
    """The cells of one line."""

    number: int  # counted from 1
    cells: tuple[str, ...]

    def cell(self, column: int) -> str:
        """A cell; empty where the line ends before it."""
        return self.cells[column] if column < len(self.cells) else ""


@dataclass(frozen=True)
class InstrumentText:
    """All lines of a file, with its decimal mark."""

    path: Path
    lines: tuple[TextLine, ...]
    decimal: str

    def is_number(self, cell: str) -> bool:
        """Whether a cell is a number."""
        return is_number(cell, self.decimal)

    def is_row(self, line: TextLine) -> bool:
        """Whether a line is one of numbers: two at least, and more of them than of texts."""
        filled = [cell for cell in line.cells if cell]
        numbers = sum(map(self.is_number, filled))
        return numbers >= 2 and numbers > len(filled) - numbers

    def number(self, cell: str) -> float:
        """The number in a cell; raises ValueError."""
        return float(cell.replace(",", ".") if self.decimal == "," else cell)


def is_number(cell: str, decimal: str) -> bool:
    """Whether a cell is a number with a decimal mark.

    >>> is_number("1,5e-3", ","), is_number("1,5", "."), is_number("1_5", ".")
    (True, False, False)
    """
    text = cell.strip()
    if decimal == ",":
        text = "" if "." in text else text.replace(",", ".", 1)
    return _NUMBER.fullmatch(text) is not None


def read_text(path: Path) -> InstrumentText:
    """The lines of a file; raises LogError where it cannot be read, or has no numbers."""
    with readable(regular(path)) as file:
        content = file.read(_LARGEST + 1)
    if len(content) > _LARGEST:
        raise LogError(f"{path}: has more than {_LARGEST // 1_000_000} MB: is not an instrument's table")
    if b"\0" in content and not content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise LogError(f"{path}: is not a text: export the table as text or CSV from the instrument's program")
    raw = _decoded(path, content).splitlines()
    if not any(line.strip() for line in raw):
        raise LogError(f"{path}: is empty")
    separator, decimal = _dialect(raw)
    cells = [tuple(cell.strip() for cell in _cells(line, separator)) for line in raw]
    found = InstrumentText(path, tuple(TextLine(n, one) for n, one in enumerate(cells, 1)), decimal)
    if decimal == ",":
        _refuse_thousands(found)
    return found


def _decoded(path: Path, content: bytes) -> str:
    encoding = next((name for mark, name in _MARKS if content.startswith(mark)), "utf-8")
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        if encoding != "utf-8":
            raise LogError(f"{path}: is a damaged {encoding} text: {error.reason} at byte {error.start}") from error
    return content.decode("cp1252", errors="replace")


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    quoted = line.lstrip().startswith('"') or f'{separator}"' in line  # the " of G" is none
    return next(csv.reader([line], delimiter=separator), []) if quoted else line.split(separator)


def _dialect(lines: Sequence[str]) -> tuple[str, str]:
    """What separates cells, and the decimal mark: those with which most cells are numbers and fewest are text."""
    sample = [line for line in lines[len(lines) // 2 :] if line.strip()][-40:] + [line for line in lines if line][:200]

    def score(dialect: tuple[str, str]) -> int:
        separator, decimal = dialect
        found = 0
        for line in sample:
            filled = [cell.strip() for cell in _cells(line, separator) if cell.strip()]
            numbers = sum(is_number(cell, decimal) for cell in filled)
            found += 2 * numbers - len(filled) if numbers >= 2 else 0
        return found

    allowed = [(s, d) for s, d in product(_SEPARATORS, ".,") if s != d]
    return max(allowed, key=score)


def _refuse_thousands(text: InstrumentText) -> None:
    """Raise LogError where every comma may stand between thousands as well."""
    rows = [(line.number, cell) for line in text.lines if text.is_row(line) for cell in line.cells if "," in cell]
    if rows and all(_GROUPED.fullmatch(cell) for _, cell in rows):
        number, cell = rows[0]
        raise LogError(
            f"{text.path}:{number}: {cell!r} can be one and a fraction or a thousand: export the table with points"
        )
