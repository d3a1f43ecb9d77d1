"""Lines of a table that are nothing but numbers, read at once."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import IO

import numpy as np
from palpate import Floats
from pydantic_core import from_json

from palpate_records.tables.dialect import Dialect
from palpate_records.tables.table_text import bounded_lines

_CHARACTERS, _LONGEST = 1 << 17, 100_000  # read at once; and to the end of the last line
_OF_NUMBERS = str.maketrans("", "", "0123456789+-.eE")  # takes away what a number is made of


def without_digits(text: str) -> str:
    """Return a text without the characters of numbers."""
    return text.translate(_OF_NUMBERS)


def whole_lines(file: IO[str]) -> Iterator[str]:
    """Yield the rest of a file, some thousand whole lines at a time."""
    while text := file.read(_CHARACTERS) + file.readline(_LONGEST):
        yield text


def lines_from(text: str, file: IO[str], path: Path) -> Iterator[str]:
    """Return the lines of a text that was read last, and of the rest of its file."""
    return chain(bounded_lines(io.StringIO(text, newline=""), path), bounded_lines(file, path))


def plain_numbers(text: str, dialect: Dialect, width: int) -> Floats | None:
    """Return the numbers (n, width) of whole lines of nothing but numbers; None for other lines.

    What is left without the characters of numbers must be the same separators in every line.
    """
    comma = dialect.delimiter
    if '"' in text or dialect.thousands or (dialect.decimal == "," and "." in text):
        return None
    text = text.replace("\r\n", "\n") if "\r" in text else text
    text = text.replace(",", ".") if dialect.decimal == "," else text
    text = text.removesuffix("\n")
    count = text.count("\n") + 1
    separators = ("\n" + comma * (width - 1)) * count
    if not text or without_digits(text) != separators[1:]:
        return None
    found = _parsed((text if comma == "," else text.replace(comma, ",")).replace("\n", ","))
    return None if found is None or found.size != count * width else found.reshape(count, width)


def _parsed(numbers: str) -> Floats | None:
    """Return the numbers (n,) between commas; None for anything else."""
    try:  # a reader of JSON, which has the same numbers but for +1, .5 and 1., takes a third of the time
        found = from_json(f"[{numbers}]")
        return np.fromiter(found, np.float64, len(found))
    except (ValueError, OverflowError):
        pass
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # text that does not end as a number
        try:
            return np.fromstring(numbers, sep=",")
        except (DeprecationWarning, ValueError):
            return None
