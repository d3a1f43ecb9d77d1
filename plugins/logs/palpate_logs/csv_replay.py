"""Replay of a CSV log."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from palpate import Batch, Link, LogError
from palpate_records.recording import Suggestion, Survey
from palpate_records.tables.csv_sheet import KEYS, Sheet
from palpate_records.tables.table_records import records_in
from palpate_records.tables.table_text import NO_RECORDS, SUFFIXES

from palpate_logs.csv_link import CsvLink
from palpate_logs.csv_roles import suggest_csv
from palpate_logs.csv_settings import CsvSettings
from palpate_logs.csv_survey import survey_csv, tables_csv
from palpate_logs.curve_export import is_exported_curve


class CsvReplay(CsvSettings):
    """A table of numbers, a text, a workbook or arrays, as a device: its columns are channels of one stream.

    Time comes from a column, or from a rate. Columns are counted, or named by the header, the line of names above the
    first row of numbers; what is above it, and comments, are left out. A cell that is empty or not finite counts as an
    invalid reading; text in a column that is used is a mistake of the file and refused, decimal commas that are not
    stated among it. Where a device is slower than the loop that wrote the rows, only the first of its equal readings
    counts. The extra `palpate[excel]` brings openpyxl, which reads workbooks.
    """

    @contextmanager
    def connect(self, seed: int) -> Iterator[Link]:
        """Open the file."""
        yield CsvLink(self)

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Return True for a file that is named like a table of numbers, and for one of another name that is a table."""
        if not path.is_file():
            return False
        name = path.name.lower()
        if name.endswith(SUFFIXES):
            return True
        return not name.startswith(".") and not name.endswith(NO_RECORDS) and _is_table(path)

    @classmethod
    def is_last_resort(cls, path: Path) -> bool:
        """See `Recording`: a text that is not named like a table may be of a format that a third party reads."""
        return not path.name.lower().endswith(SUFFIXES)

    @classmethod
    def records(cls, path: Path, choices: Mapping[str, str]) -> tuple[str, ...]:
        """See `Recording`."""
        stated = {key: choices[key] for key in KEYS if key in choices}
        return tuple(record.name for record in records_in(path, stated))

    @classmethod
    def survey(cls, path: Path) -> Survey:
        """See `Recording`."""
        return survey_csv(path)

    @classmethod
    def suggest(cls, path: Path, choices: Mapping[str, str]) -> Suggestion:
        """See `Recording`; columns are chosen by their name or number, ``rate`` or ``time`` gives the time.

        Keys of the device, such as ``decimal``, are taken as they are given.
        """
        return suggest_csv(path, choices)

    @classmethod
    def tables(cls, path: Path, notes: list[str] | None = None) -> Iterator[tuple[str, tuple[str, ...], Batch]]:
        """See `Recording`."""
        return tables_csv(path, notes)


def _is_table(path: Path) -> bool:
    """Return True for a file with rows of numbers in several columns."""
    try:
        return not is_exported_curve(path) and len(Sheet.of(path).names) > 1
    except (LogError, OSError):
        return False
