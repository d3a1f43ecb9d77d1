"""The table of many curves: each is a row, with the uncertainty and the verdict of a fit of its own."""

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

from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_fits import CurveReader, Row, value_units
from palpate_kit.curves.fit_provenance import add_provenance
from palpate_kit.curves.folder_settings import SETTINGS, dialects_in, reading_keys, settings_text, write_dialects
from palpate_kit.runs.pipeline_diff import differences
from palpate_kit.terminal.motion_text import MOTION_COLUMNS

TABLE = "fits.csv"
_HEAD, _KINDS = ("curve", "track"), ("", "_std", "_combined")
_TEXTS = ("curve", "track", "better_laws", "findings", "conditions", "needs", "flags", "settings", "error")
_LINE = 1 << 16  # [bytes] of the head
_RECENT = (
    "prediction",
    *MOTION_COLUMNS,
    "better_laws",
    "findings",
)  # columns that tables may lack which were written before 0462
_OF_TRACK = ("samples", "x", "y", "verdict", "conditions", "needs", "flags", "settings", "error")
_TAIL = ("rms", *_RECENT, *_OF_TRACK)
_LATER = (*_RECENT, "conditions", "needs")  # those before schema 5, as they lack the verdict of each value


class FitTable:
    """``fits.csv``: written curve by curve, and gone on with where it ends; the latest rows of a curve count."""

    def __init__(self, folder: Path, pipeline: Pipeline, device: str, dialect: str = "") -> None:
        self.columns = columns_of_fits(pipeline)
        self._tracks = len(pipeline.tracks)
        self._noted = False  # by which command and versions rows are added
        self.path = folder / TABLE
        self._settle(folder, pipeline, device, dialect)
        self.settings = settings_text(folder / SETTINGS, dialect)
        self.done = self._whole() if self.path.exists() else dict[str, str]()
        if not self.path.exists():
            write_rows(self.path, self.columns, ())

    def _settle(self, folder: Path, pipeline: Pipeline, device: str, dialect: str) -> None:
        """Begin a folder, or go on with one that was begun with the same settings; raises OutputError."""
        text = resolved_text(pipeline, folder)
        ignored = {*pipeline.registry.tables, *reading_keys(device)}
        settings = folder / SETTINGS
        if dialect and settings.exists() and dialect not in dialects_in(settings):  # files that are read in another way
            write_dialects(settings, {dialect: text})
        elif not settings.exists():
            if folder.exists() and any(folder.iterdir()):
                raise OutputError(f"{folder}: is not empty, and holds no fits to go on with")
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise OutputError(f"{folder}: cannot write: {error.strerror}") from error
            write_whole(settings, text)
        elif told := differences(text, settings_text(settings, dialect), ignored):
            raise OutputError(f"{folder}: was begun with other settings: {told}; nothing is mixed: give --out another")

    def _whole(self) -> dict[str, str]:
        """Return the settings of each curve that has all its rows; what is behind the last of them, torn, is cut."""
        found: dict[str, str] = {}
        name, count = "", 0
        head, end = _head_of(self.path)
        if head != self.columns and _lacks_recent_alone(head, self.columns):
            replace_columns(self.path, self.columns)
            head, end = _head_of(self.path)
        if head != self.columns:
            raise OutputError(f"{self.path}: has the columns of another version; nothing is mixed: give --out another")
        for behind, row in rows_of_fits(self.path):
            count = count + 1 if row["curve"] == name and count < self._tracks else 1
            name = row["curve"]
            if count == self._tracks or (row["error"] and not row["track"]):
                found[name], end = row["settings"], behind
        if end < self.path.stat().st_size:
            with file_in_place(self.path) as file:
                file.truncate(end)
        return found

    def left(self, curves: Iterable[Curve], reader: CurveReader) -> Iterable[Curve]:
        """Return the curves that have no rows by their present settings."""
        return (curve for curve in curves if self.done.get(curve.name) != reader.key(curve.own))

    def _text(self, rows: Iterable[Mapping[str, str]]) -> str:
        text = io.StringIO()
        csv.DictWriter(text, self.columns, lineterminator="\n").writerows(rows)
        return text.getvalue()

    def add(self, rows: Sequence[Row]) -> None:
        """The rows of one curve, in one writing."""
        if not self._noted:
            add_provenance(self.path.parent)
            self._noted = True
        lines = [{key: " ".join(value.split()) for key, value in row.items()} for row in rows]
        with file_in_place(self.path) as file:
            file.seek(0, io.SEEK_END)
            file.write(self._text(lines).encode())

    def compact(self, names: Sequence[str] = ()) -> None:
        """Rewrite the table where it holds rows that later ones stand for, or not in the order of the names."""
        known = latest_rows(self.path)
        rows = _sorted_by_curve(known, names)
        with self.path.open("rb") as file:
            lines = sum(1 for _ in file) - 1
        if lines > len(rows) or rows != known:
            write_rows(self.path, self.columns, rows)


def list_unread(path: Path, errors: Mapping[str, str], names: Sequence[str]) -> None:
    """Give each file that could not be read a row with its error, in the order of the names, and no other file."""
    known = latest_rows(path)
    unread = [{"curve": name, "error": " ".join(error.split())} for name, error in errors.items()]
    rows = _sorted_by_curve([*fitted_rows(path), *unread], names)
    if [(row["curve"], row["error"]) for row in rows] != [(row["curve"], row["error"]) for row in known]:
        write_rows(path, columns_in(path), rows)


def _sorted_by_curve(rows: Iterable[Row], names: Sequence[str]) -> list[Row]:
    """Return rows in the order of the names of their curves, all others behind them."""
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
    table.writerows(rows)
    write_whole(path, text.getvalue())


def columns_of_fits(pipeline: Pipeline) -> tuple[str, ...]:
    """Return the columns of a table of the fits of a pipeline."""
    names = [*dict.fromkeys(name for track in pipeline.tracks for name in value_units(track.model)), "surface"]
    return _columns(names)


def _columns(names: Sequence[str]) -> tuple[str, ...]:
    """Return every value with its uncertainties and its verdict, but for the surface, which has none."""
    of_values = [f"{name}{kind}" for name in names for kind in (*_KINDS, *(["_verdict"] if name != names[-1] else []))]
    return (*_HEAD, *of_values, *_TAIL)


def _lacks_recent_alone(head: tuple[str, ...], columns: tuple[str, ...]) -> bool:
    """Return True for the columns of this version, or of one before it that lacks some of the recent ones."""
    return head == tuple(name for name in columns if name in head or name not in _RECENT)


def demand_columns(path: Path) -> None:
    """Raise LogError for a table of fits that another version has written, or that is not one."""
    head, _ = _head_of(path)
    names = [name.removesuffix("_std") for name in head if name.endswith("_std")]
    now = _columns(names)
    before_verdicts = tuple(name for name in now if name not in _LATER and not name.endswith("_verdict"))
    if head != before_verdicts and not _lacks_recent_alone(head, now):
        about = "was written by another version of palpate" if head[:1] == _HEAD[:1] else "is not a table of fits"
        raise LogError(f"{path}: {about}: fit the curves again with another --out")


def columns_in(path: Path) -> tuple[str, ...]:
    """Return the columns of a table of fits; raises LogError where it cannot be read."""
    return _head_of(path)[0]


def latest_rows(path: Path) -> list[Row]:
    """Return the rows of a table of fits, of each curve those that were written last, in the order of the first."""
    rows: dict[str, dict[str, Row]] = {}
    for _, row in rows_of_fits(path):
        of_curve = rows.setdefault(row["curve"], {})
        old = next(iter(of_curve.values()), row)
        if not row["track"] or not old["track"] or old.get("settings") != row.get("settings"):
            of_curve.clear()
        of_curve[row["track"]] = row
    return [row for of_curve in rows.values() for row in of_curve.values()]


def fitted_rows(path: Path) -> list[Row]:
    """Return the latest rows of the curves that were read."""
    return [row for row in latest_rows(path) if row["track"] or row.get("settings")]


def rows_of_fits(path: Path) -> Iterator[tuple[int, Row]]:
    """Yield every row of a table of fits with the place [bytes] behind it; a last line that is torn is left out.

    Raises LogError with line and column for a row that lacks cells, and for a cell that is not what it has to be.
    """
    head, begin = _head_of(path)
    with _readable(path) as file:
        file.seek(begin)
        for number, line in enumerate(iter(file.readline, b""), start=2):
            if not line.endswith(b"\n"):
                return
            cells = next(csv.reader([line.decode()]), [])
            if len(cells) != len(head):
                raise LogError(f"{path}:{number}: has {len(cells)} cells for {len(head)} columns")
            row = dict(zip(head, cells, strict=True))
            for name, cell in row.items():
                if wanted := _wanted(name, cell):
                    raise LogError(f"{path}:{number}: column {name} holds {cell[:40]!r}, expected a {wanted}")
            yield file.tell(), row


def _wanted(name: str, cell: str) -> str:
    """What a cell has to be, where it is not; "" where it is."""
    if not cell or name in _TEXTS:
        return ""
    if name == "verdict" or name.endswith("_verdict"):
        return "" if cell in ("good", *SEVERITIES) or is_open(cell) else "verdict"
    return "" if is_number(cell) else "number"


def _head_of(path: Path) -> tuple[tuple[str, ...], int]:
    """Return the columns of a table, and where its rows begin [bytes]; raises LogError."""
    with _readable(path) as file:
        return tuple(next(csv.reader([file.readline(_LINE).decode()]), ())), file.tell()


@contextmanager
def _readable(path: Path) -> Iterator[IO[bytes]]:
    try:
        with readable(regular(path)) as file:
            yield file
    except (UnicodeDecodeError, csv.Error) as error:
        raise LogError(f"{path}: is not a table of fits of palpate: {error}") from error
