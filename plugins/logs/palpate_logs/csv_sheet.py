"""A CSV file without a description: its separator, its header, its numbers, and the units in their names."""

from __future__ import annotations

import csv
import gzip
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import IO

import numpy as np
from palpate import Floats, LogError, is_number, printable
from palpate_kit.logs.decompression import DAMAGED
from palpate_kit.logs.log_files import regular
from palpate_kit.logs.readings import si_unit

from palpate_logs.csv_cells import POINTS, has_decimal_comma, is_cut_at_commas, number_or_nan

SUFFIXES = (".csv", ".csv.gz", ".tsv", ".tsv.gz")
_SEPARATORS = (",", ";", "\t")
_LOOKED = 50  # lines by which the separator is found
_LINE = 100_000  # characters; the csv module takes no longer cell
_BLOCK = 4096  # rows at once
_UNIT = 20  # characters of a unit; a longer one is none
_NAME, _NAMED = 40, 12  # characters of a column's name, and columns, that are shown
_LOADS = ("mN", "kN", "kgf", "gf", "kg", "N", "g")
_SUFFIXES = ("mm_s", "um_s", "m_s", "mm", "um", "cm", *_LOADS, "ns", "us", "ms", "m", "s")
_WEIGHT = {"g": "gf", "kg": "kgf", "lb": "lbf"}  # a load cell that was calibrated with masses
_LOAD = re.compile(r"force|load|weight|kraft|gewicht|^fz?\b|^fz?_", re.IGNORECASE)  # g is also an acceleration
_BEHIND = re.compile(r"(?:\s*/\s*|,\s*|\s+in\s+)(\S{1,20})")  # "Force / N", "Force, N", "Force in N"


@dataclass(frozen=True)
class Sheet:
    """How a file is written."""

    path: Path
    delimiter: str
    names: tuple[str, ...]  # of the header, or "0", "1", ...
    header: bool

    @classmethod
    def of(cls, path: Path) -> Sheet:
        """Found from the first lines; raises LogError where they are no table of numbers."""
        with open_text(path) as file:
            lines = [line for line in islice(bounded_lines(file, path), _LOOKED) if line.strip()]
        if not lines:
            raise LogError(f"{path}: the file is empty")
        widths = {s: [len(row) for row in csv.reader(lines, delimiter=s)] for s in _SEPARATORS}
        best = max(_SEPARATORS, key=lambda s: (len(set(widths[s][1:])) <= 1, min(widths[s])))
        first, *rest = csv.reader(lines, delimiter=best)
        header = not any(is_number(cell) for cell in first)
        _refuse_decimal_commas(path, lines, best, first if header else None, rest)
        names = [cell.strip().lstrip("\ufeff") for cell in first] if header else list(map(str, range(len(first))))
        if not (rest if header else [first]):
            raise LogError(f"{path}: the file contains no rows of numbers")
        return cls(path, best, tuple(name or str(k) for k, name in enumerate(names)), header)

    def blocks(self) -> Iterator[Floats]:
        """The numbers (n, k), some thousand rows at a time; NaN where a cell is none."""
        with open_text(self.path) as file:
            rows = csv.reader(bounded_lines(file, self.path), delimiter=self.delimiter)
            if self.header:
                next(rows, None)
            while part := list(islice(rows, _BLOCK)):
                block = np.full((len(part), len(self.names)), np.nan)
                for i, cells in enumerate(part):
                    block[i, : len(cells)] = [number_or_nan(cell) for cell in cells[: len(self.names)]]
                yield block[[bool(cells) for cells in part]]

    def unit(self, column: int) -> str | None:
        """The unit that the name of a column ends in, for a load in grams gf; None where it names none."""
        unit = _unit_text(self.names[column])
        if _LOAD.search(self.names[column]):
            unit = _WEIGHT.get(unit, unit)
        try:
            return unit if unit and si_unit(unit) else None
        except ValueError:
            return None

    def column(self, index: int) -> int | str:
        """How a pipeline names a column: by the header where that is clear, else by its number."""
        return self.names[index] if self.header and self.names.count(self.names[index]) == 1 else index

    @property
    def columns(self) -> str:
        """The columns that there are, not more than a line can hold."""
        names = [column_text(name) for name in self.names[:_NAMED]]
        return ", ".join(names) + (", ..." if len(self.names) > _NAMED else "")

    def index_of(self, role: str, choice: str) -> int:
        """The column that a choice names, by the header or by its number; raises LogError where there is none."""
        if choice in self.names:
            return self.names.index(choice)
        if choice.isdigit() and int(choice) < len(self.names):
            return int(choice)
        raise LogError(f"{self.path}: --{role}: there is no column {choice!r} (there are: {self.columns})")


def column_text(column: int | str) -> str:
    """The name or the number of a column, cut and without what a terminal would obey."""
    return printable(str(column))[:_NAME]


def _refuse_decimal_commas(
    path: Path, lines: list[str], delimiter: str, header: list[str] | None, rows: list[list[str]]
) -> None:
    cut = bool(rows) and all(is_cut_at_commas(row, header, delimiter) for row in rows)
    if cut or any(has_decimal_comma(cell) for row in rows[:5] for cell in row):
        raise LogError(f"{path}: its numbers have decimal commas ({lines[-1].strip()[:40]!r}): {POINTS}")


def _unit_text(name: str) -> str:
    """What stands in the last brackets of a name, or behind its last ``_``, ``/``, comma or "in"; empty for none."""
    name = name.strip()
    if name[-1:] in ("]", ")"):
        begin = max(name.rfind("["), name.rfind("("))
        unit = name[begin + 1 : -1].strip() if begin >= 0 else ""
        return unit.replace("_s", "/s").replace("^-1", "") if len(unit) <= _UNIT else ""
    found = next((unit for unit in _SUFFIXES if name.endswith(f"_{unit}") and len(name) > len(unit) + 1), "")
    if not found and (behind := list(_BEHIND.finditer(name))) and behind[-1].end() == len(name):
        return behind[-1][1]
    return found.replace("_s", "/s")


@contextmanager
def open_text(path: Path) -> Iterator[IO[str]]:
    """The text of a file, plain or gzipped; raises LogError where it cannot be read."""
    regular(path)
    try:
        if path.suffix == ".gz":
            with gzip.open(path, "rt", encoding="utf-8", newline="") as file:
                yield file
        else:
            with path.open(newline="", encoding="utf-8") as file:
                yield file
    except (OSError, *DAMAGED) as error:
        raise LogError(f"{path}: cannot be read: {error}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise LogError(f"{path}: is not a CSV text: {error}") from error


def bounded_lines(file: IO[str], path: Path) -> Iterator[str]:
    """The lines of a text, none of which may be longer than a line of numbers is."""
    while line := file.readline(_LINE):
        if len(line) == _LINE and not line.endswith("\n"):
            raise LogError(f"{path}: is not a CSV text: a line has more than {_LINE} characters")
        yield line


def together(blocks: Iterator[Floats], limit: int) -> Floats:
    """The first rows of a table, up to a limit."""
    kept: list[Floats] = []
    for block in chain(blocks):
        kept.append(block)
        if sum(map(len, kept)) >= limit:
            break
    return np.concatenate(kept)[:limit]
