"""Whole blocks of lines of plain numbers, read at once."""

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

_BLOCK_CHARACTERS = 1 << 17  # that are read at once: a choice
_MAX_LINE = 100_000  # characters, to the end of the last line of a block: the csv module takes no longer cell
_WITHOUT_DIGITS = str.maketrans("", "", "0123456789+-.eE")  # table of str.translate that removes these characters


def without_digits(text: str) -> str:
    """Return a text without the characters of numbers."""
    return text.translate(_WITHOUT_DIGITS)


def whole_lines(file: IO[str]) -> Iterator[str]:
    """Yield the rest of a file, some thousand whole lines at a time."""
    while text := file.read(_BLOCK_CHARACTERS) + file.readline(_MAX_LINE):
        yield text


def lines_from(text: str, file: IO[str], path: Path) -> Iterator[str]:
    """Return the lines of a text, then those of the file behind it; raises LogError for a line that is too long."""
    return chain(bounded_lines(io.StringIO(text, newline=""), path), bounded_lines(file, path))


def plain_numbers(text: str, dialect: Dialect, width: int) -> Floats | None:
    """Return the numbers (n, width) of whole lines of plain numbers; None for other lines.

    `dialect` is how the text is written: the marks between columns and of decimals. Without the characters of numbers,
    every line must be the same separators.
    """
    delimiter = dialect.delimiter
    if '"' in text or dialect.thousands or (dialect.decimal == "," and "." in text):
        return None
    if "\r" in text:
        text = text.replace("\r\n", "\n")
    if dialect.decimal == ",":
        text = text.replace(",", ".")
    text = text.removesuffix("\n")
    count = text.count("\n") + 1
    # The same separators in every line leave as many numbers in each.
    separators = ("\n" + delimiter * (width - 1)) * count
    if not text or without_digits(text) != separators[1:]:
        return None
    if delimiter != ",":
        text = text.replace(delimiter, ",")
    numbers = _parse_numbers(text.replace("\n", ","))
    return None if numbers is None or numbers.size != count * width else numbers.reshape(count, width)


def _parse_numbers(text: str) -> Floats | None:
    """Return the numbers (n,) between commas; None for anything else."""
    # A reader of JSON, which has the same numbers except +1, .5 and 1., takes a third of the time of NumPy's.
    try:
        numbers = from_json(f"[{text}]")
        return np.fromiter(numbers, np.float64, len(numbers))
    except (ValueError, OverflowError):
        pass
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # for text that does not end as a number
        try:
            return np.fromstring(text, sep=",")
        except (DeprecationWarning, ValueError):
            return None
