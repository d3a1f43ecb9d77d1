"""``conditions.csv``: each sentence on an open fact once, by the code that rows of ``fits.csv`` have in its place."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from itertools import count
from pathlib import Path

from palpate import LogError
from palpate_engine import file_in_place
from palpate_records.log_files import readable, regular

CONDITIONS = "conditions.csv"
_COLUMNS = ("code", "fact", "sentence")
_HEAD = ",".join(_COLUMNS) + "\n"
_SEPARATOR = "; "  # of the entries of a cell, "FACT: SENTENCE"
_FACT_END = ": "
_FIRST_REPEAT = 2  # number in the code of the second sentence on a fact; the code of the first is the fact
_MAX_SHOWN = 80  # characters of a wrong line: a choice
_LOST = f"its sentence is not in {CONDITIONS}"


class ConditionCodes:
    """The conditions of a table of fits, in words and as codes.

    The first sentence on a fact has the fact as its code, the second ``FACT.2``. Sentences are only ever added, each
    before the row that names its code, so that a row is never without its sentence.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / CONDITIONS
        self._entries: dict[str, str] = {}  # "FACT: SENTENCE" by code
        self._codes: dict[str, str] = {}  # the reverse
        self._cells: dict[str, str] = {}  # of words by the cells of codes that were read
        self._end = 0  # [bytes] of the whole lines of the file
        self._read()

    def words(self, codes: str) -> str:
        """Return a cell in words; one that earlier versions wrote is in words already. Raises LogError."""
        if not codes or _FACT_END in codes:
            return codes
        if codes not in self._cells:
            if any(code not in self._entries for code in codes.split()):
                self._read()  # another process may have added rows since
            entries = [self._entries.get(code, f"{code}{_FACT_END}{_LOST}") for code in codes.split()]
            self._cells[codes] = _SEPARATOR.join(entries)
        return self._cells[codes]

    def codes(self, cells: Iterable[str]) -> list[str]:
        """Return cells in words as cells of codes; new sentences are appended to the file. Raises OutputError."""
        entries_of_cells = [[entry for entry in cell.split(_SEPARATOR) if entry] for cell in cells]
        new = {entry: None for entries in entries_of_cells for entry in entries if entry not in self._codes}
        if new:
            self._read()  # the tables of other dialects, and other processes, add sentences as well
            self._append([(self._new_code(entry), entry) for entry in new if entry not in self._codes])
        return [" ".join(map(self._codes.__getitem__, entries)) for entries in entries_of_cells]

    def _new_code(self, entry: str) -> str:
        """Return a new code, and enter it for "FACT: SENTENCE"."""
        # Codes stand between spaces, and a fact may have some: "unit of fz".
        fact = "_".join(entry.partition(_FACT_END)[0].split())
        numbered = (f"{fact}.{number}" for number in count(_FIRST_REPEAT))
        code = fact if fact not in self._entries else next(code for code in numbered if code not in self._entries)
        self._enter(code, entry)
        return code

    def _enter(self, code: str, entry: str) -> None:
        self._entries[code] = entry
        self._codes[entry] = code

    def _append(self, entries: Sequence[tuple[str, str]]) -> None:
        """Append codes with their entries "FACT: SENTENCE" behind the last whole line of the file, in one write."""
        if not entries:
            return
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        for code, entry in entries:
            fact, _, sentence = entry.partition(_FACT_END)
            table.writerow((code, fact, sentence))
        with file_in_place(self._path) as file:
            # A process that was killed may have left a part of a line.
            file.truncate(self._end)
            file.seek(self._end)
            lines = (text.getvalue() if self._end else _HEAD + text.getvalue()).encode()
            file.write(lines)
        self._end += len(lines)

    def _read(self) -> None:
        """Read the whole lines of the file that were not read yet; raises LogError for a line of other columns."""
        if not self._path.exists():
            return
        try:
            with readable(regular(self._path)) as file:
                file.seek(self._end)
                for line in iter(file.readline, b""):
                    is_torn = not line.endswith(b"\n")
                    if self._end == 0 and not _HEAD.startswith(line.decode().replace("\r\n", "\n")):
                        raise ValueError(line.decode()[:_MAX_SHOWN])
                    if is_torn:
                        break
                    if self._end > 0:
                        self._take(line.decode())
                    self._end = file.tell()
        except (UnicodeDecodeError, csv.Error, ValueError) as error:
            columns = ", ".join(_COLUMNS)
            raise LogError(f"{self._path}: lacks the columns {columns}: {error}") from error

    def _take(self, line: str) -> None:
        """Enter the sentence of a line; raises ValueError for one of other columns."""
        cells = next(csv.reader([line]), [])
        if len(cells) != len(_COLUMNS):
            raise ValueError(line[:_MAX_SHOWN])
        code, fact, sentence = cells
        self._enter(code, f"{fact}{_FACT_END}{sentence}")
