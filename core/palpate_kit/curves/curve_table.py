"""``fits.csv``, the table of many curves: a row for each track of a curve, with its uncertainties and verdicts."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from palpate import LogError, OutputError, is_number
from palpate_engine import (
    SEVERITIES,
    Pipeline,
    file_in_place,
    is_open,
    resolved_text,
    write_whole,
)
from palpate_records.log_files import readable, regular

from palpate_kit.curves.condition_codes import ConditionCodes
from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_fits import CurveReader, Row, value_units
from palpate_kit.curves.fit_provenance import add_provenance
from palpate_kit.curves.folder_settings import SETTINGS, dialects_in, reading_keys, settings_text, write_dialects
from palpate_kit.runs.pipeline_diff import differences
from palpate_kit.terminal.motion_text import MOTION_COLUMNS

TABLE = "fits.csv"
_CONDITIONS = "conditions"  # the column whose sentences are in a file of their own
_FIRST_COLUMNS = ("curve", "track")
_NUMBER_SUFFIXES = ("", "_std", "_combined")  # of the columns of a value
_TEXT_COLUMNS = ("curve", "track", "better_laws", "findings", "conditions", "needs", "flags", "settings", "error")
_MAX_HEAD = 1 << 16  # [bytes] that are read of the line of column names: a choice
# Columns that tables written before 0462 may lack.
_RECENT_COLUMNS = ("prediction", *MOTION_COLUMNS, "better_laws", "findings")
_TRACK_COLUMNS = ("samples", "x", "y", "verdict", "conditions", "needs", "flags", "settings", "error")
_LAST_COLUMNS = ("rms", *_RECENT_COLUMNS, *_TRACK_COLUMNS)
# Columns that tables written before schema 5 lack, as they do the verdict of each value.
_COLUMNS_SINCE_VERDICTS = (*_RECENT_COLUMNS, "conditions", "needs")


class FitTable:
    """``fits.csv``, to which the rows of one curve after the other are appended; the latest rows of a curve count."""

    def __init__(self, folder: Path, pipeline: Pipeline, device: str, dialect: str = "") -> None:
        self.columns = columns_of_fits(pipeline)
        self._tracks = len(pipeline.tracks)
        self._has_provenance = False  # True once the command and the versions that add rows are noted
        self.path = folder / TABLE
        self._write_settings(folder, pipeline, device, dialect)
        self._condition_codes = ConditionCodes(folder)
        self.settings = settings_text(folder / SETTINGS, dialect)
        self.done = self._read_complete_curves() if self.path.exists() else dict[str, str]()
        if not self.path.exists():
            write_rows(self.path, self.columns, ())

    def _write_settings(self, folder: Path, pipeline: Pipeline, device: str, dialect: str) -> None:
        """Write the pipeline of a dialect into the folder, or check that the one that it has is the same.

        A dialect names the curves whose files one pipeline reads, by its `device` of that name. Raises OutputError for
        a folder with other settings, one that holds anything else, and one that cannot be made.
        """
        text = resolved_text(pipeline, folder)
        ignored = {*pipeline.registry.tables, *reading_keys(device)}  # tables of analyses, and the place of the curve
        settings = folder / SETTINGS
        # A further dialect is added to the settings; others must be the same as before.
        if dialect and settings.exists() and dialect not in dialects_in(settings):
            write_dialects(settings, {dialect: text})
        elif not settings.exists():
            if folder.exists() and any(folder.iterdir()):
                raise OutputError(f"{folder}: is not empty, and holds no fits to go on with")
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise OutputError(f"{folder}: cannot write: {error.strerror}") from error
            write_whole(settings, text)
        elif changes := differences(text, settings_text(settings, dialect), ignored):
            raise OutputError(
                f"{folder}: was begun with other settings: {changes}; nothing is mixed: give --out another"
            )

    def _read_complete_curves(self) -> dict[str, str]:
        """Return the key of the settings of each curve that has the rows of all its tracks; cut the file behind them.

        A process that was killed may have left some rows of a curve, or a part of one. Raises OutputError for a table
        with other columns, except those of an earlier version, which are replaced.
        """
        complete: dict[str, str] = {}
        name, count = "", 0
        head, end = _read_head(self.path)
        if head != self.columns and _lacks_recent_columns_only(head, self.columns):
            replace_columns(self.path, self.columns)
            head, end = _read_head(self.path)
        if head != self.columns:
            raise OutputError(f"{self.path}: has the columns of another version; nothing is mixed: give --out another")
        # A curve is complete with the row of its last track, or with one row of the curve as a whole.
        for row_end, row in rows_of_fits(self.path):
            is_next_track = row["curve"] == name and count < self._tracks
            count = count + 1 if is_next_track else 1
            name = row["curve"]
            if count == self._tracks or (row["error"] and not row["track"]):
                complete[name] = row["settings"]
                end = row_end
        if end < self.path.stat().st_size:
            with file_in_place(self.path) as file:
                file.truncate(end)
        return complete

    def unfitted_curves(self, curves: Iterable[Curve], reader: CurveReader) -> Iterable[Curve]:
        """Return the curves that have no rows by their present settings."""
        return (curve for curve in curves if self.done.get(curve.name) != reader.key(curve.own))

    def _csv_text(self, rows: Iterable[Mapping[str, str]]) -> str:
        text = io.StringIO()
        csv.DictWriter(text, self.columns, lineterminator="\n").writerows(_coded_rows(rows, self._condition_codes))
        return text.getvalue()

    def add(self, rows: Sequence[Row]) -> None:
        """Append the rows of one curve in a single write, so that they are not torn apart."""
        if not self._has_provenance:
            add_provenance(self.path.parent)
            self._has_provenance = True
        lines = [{key: " ".join(value.split()) for key, value in row.items()} for row in rows]
        text = self._csv_text(lines)  # new sentences are in their file before the rows that name them
        with file_in_place(self.path) as file:
            file.seek(0, io.SEEK_END)
            file.write(text.encode())

    def compact(self, names: Sequence[str] = ()) -> None:
        """Rewrite the table without outdated rows, in the order of the names; a table that is so already stays."""
        latest = latest_rows(self.path)
        rows = _sorted_by_curve(latest, names)
        with self.path.open("rb") as file:
            line_count = sum(1 for _ in file) - 1
        if line_count > len(rows) or rows != latest:
            write_rows(self.path, self.columns, rows)


def list_unread(path: Path, errors: Mapping[str, str], names: Sequence[str]) -> None:
    """Give each file that could not be read a row with its error, in the order of the names.

    Such rows of other files are removed.
    """
    latest = latest_rows(path)
    unread = [{"curve": name, "error": " ".join(error.split())} for name, error in errors.items()]
    rows = _sorted_by_curve([*fitted_rows(path), *unread], names)
    if [(row["curve"], row["error"]) for row in rows] != [(row["curve"], row["error"]) for row in latest]:
        write_rows(path, columns_in(path), rows)


def _sorted_by_curve(rows: Iterable[Row], names: Sequence[str]) -> list[Row]:
    """Return rows in the order of the names of their curves; those of other curves last."""
    places = {name: place for place, name in enumerate(names)}
    return sorted(rows, key=lambda row: places.get(row["curve"], len(places)))


def replace_columns(path: Path, columns: Sequence[str]) -> None:
    """Rewrite a table of fits with other columns; cells of a new column are empty."""
    write_rows(path, columns, latest_rows(path))


def write_rows(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, str]]) -> None:
    """Write a whole table of fits; a cell that a row lacks is empty."""
    text = io.StringIO()
    table = csv.DictWriter(text, columns, lineterminator="\n", restval="", extrasaction="ignore")
    table.writeheader()
    table.writerows(_coded_rows(rows, ConditionCodes(path.parent)))
    write_whole(path, text.getvalue())


def _coded_rows(rows: Iterable[Mapping[str, str]], condition_codes: ConditionCodes) -> list[Mapping[str, str]]:
    """Return rows with codes in place of the sentences of their conditions, which are then in their own file."""
    row_list = [*rows]
    codes = condition_codes.codes(row.get(_CONDITIONS, "") for row in row_list)
    return [{**row, _CONDITIONS: cell} for row, cell in zip(row_list, codes, strict=True)]


def columns_of_fits(pipeline: Pipeline) -> tuple[str, ...]:
    """Return the columns of a table of the fits of a pipeline."""
    names = [*dict.fromkeys(name for track in pipeline.tracks for name in value_units(track.model)), "surface"]
    return _columns(names)


def _columns(names: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of a table of named values, the last of which is the surface, and has no verdict."""
    value_columns = []
    for name in names:
        value_columns += [f"{name}{suffix}" for suffix in _NUMBER_SUFFIXES]
        if name != names[-1]:
            value_columns.append(f"{name}_verdict")
    return (*_FIRST_COLUMNS, *value_columns, *_LAST_COLUMNS)


def _lacks_recent_columns_only(head: tuple[str, ...], columns: tuple[str, ...]) -> bool:
    """Return True if a head has the columns of this version, but perhaps for some of the recent ones."""
    return head == tuple(name for name in columns if name in head or name not in _RECENT_COLUMNS)


def demand_columns(path: Path) -> None:
    """Raise LogError for a table of fits with the columns of an unknown version, or that is not one.

    Those before schema 5, without verdicts of values, can be read.
    """
    head, _ = _read_head(path)
    # Each value has a column of its name, and one of its standard deviation.
    names = [name.removesuffix("_std") for name in head if name.endswith("_std")]
    columns = _columns(names)
    columns_before_verdicts = tuple(
        name for name in columns if name not in _COLUMNS_SINCE_VERDICTS and not name.endswith("_verdict")
    )
    if head != columns_before_verdicts and not _lacks_recent_columns_only(head, columns):
        is_table_of_fits = head[:1] == _FIRST_COLUMNS[:1]
        problem = "was written by another version of palpate" if is_table_of_fits else "is not a table of fits"
        raise LogError(f"{path}: {problem}: fit the curves again with another --out")


def columns_in(path: Path) -> tuple[str, ...]:
    """Return the columns of a table of fits; raises LogError for one that cannot be read."""
    return _read_head(path)[0]


def latest_rows(path: Path) -> list[Row]:
    """Return the latest rows of each curve of a table of fits, the curves in the order of their first rows."""
    rows_by_curve: dict[str, dict[str, Row]] = {}  # then by track
    for _, row in rows_of_fits(path):
        rows_by_track = rows_by_curve.setdefault(row["curve"], {})
        earlier_row = next(iter(rows_by_track.values()), row)
        # A row by other settings, and one of the curve as a whole, replaces those of all tracks.
        is_of_curve = not row["track"] or not earlier_row["track"]
        if is_of_curve or earlier_row.get("settings") != row.get("settings"):
            rows_by_track.clear()
        rows_by_track[row["track"]] = row
    return [row for rows_by_track in rows_by_curve.values() for row in rows_by_track.values()]


def fitted_rows(path: Path) -> list[Row]:
    """Return the latest rows of the curves whose files could be read."""
    return [row for row in latest_rows(path) if row["track"] or row.get("settings")]


def rows_of_fits(path: Path) -> Iterator[tuple[int, Row]]:
    """Yield every row of a table of fits with the position [bytes] of its end; without a torn last line.

    Conditions are in words, in place of the codes that the table has.

    Raises LogError with line and column for a row that lacks cells, and for a cell that is not a number or a verdict
    where its column holds these.
    """
    head, begin = _read_head(path)
    condition_codes = ConditionCodes(path.parent)
    with _open_table(path) as file:
        file.seek(begin)
        for number, line in enumerate(iter(file.readline, b""), start=2):
            # A process that was killed may have left a part of a line.
            if not line.endswith(b"\n"):
                return
            cells = next(csv.reader([line.decode()]), [])
            if len(cells) != len(head):
                raise LogError(f"{path}:{number}: has {len(cells)} cells for {len(head)} columns")
            row = dict(zip(head, cells, strict=True))
            for name, cell in row.items():
                if expected := _unmet_type(name, cell):
                    raise LogError(f"{path}:{number}: column {name} holds {cell[:40]!r}, expected a {expected}")
            if row.get(_CONDITIONS):
                row[_CONDITIONS] = condition_codes.words(row[_CONDITIONS])
            yield file.tell(), row


def _unmet_type(name: str, cell: str) -> str:
    """Return "number" or "verdict" if the column needs one and the cell holds anything else; "" for a sound cell."""
    if not cell or name in _TEXT_COLUMNS:
        return ""
    if name == "verdict" or name.endswith("_verdict"):
        return "" if cell in ("good", *SEVERITIES) or is_open(cell) else "verdict"
    return "" if is_number(cell) else "number"


def _read_head(path: Path) -> tuple[tuple[str, ...], int]:
    """Return the columns of a table and the position [bytes] of its first row; raises LogError."""
    with _open_table(path) as file:
        return tuple(next(csv.reader([file.readline(_MAX_HEAD).decode()]), ())), file.tell()


@contextmanager
def _open_table(path: Path) -> Iterator[IO[bytes]]:
    """Open a table of fits; what is read of it raises LogError if it is not one."""
    try:
        with readable(regular(path)) as file:
            yield file
    except (UnicodeDecodeError, csv.Error) as error:
        raise LogError(f"{path}: is not a table of fits of palpate: {error}") from error
