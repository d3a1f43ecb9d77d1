"""The text of a table in a file: its encoding, gzip, workbooks, lines of limited length."""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from palpate import LogError

from palpate_records.decompression import DAMAGED
from palpate_records.log_files import regular
from palpate_records.tables.binary_tables import binary_table_text, is_binary_table
from palpate_records.tables.workbook import WORKBOOKS

SUFFIXES = (".csv", ".csv.gz", ".tsv", ".tsv.gz", *WORKBOOKS)
# Endings of texts and copies that hold no record, though they may have rows of numbers.
NO_RECORDS = (
    ".toml", ".yaml", ".yml", ".xml", ".html", ".md", ".rst", ".tex", ".py", ".ipynb", ".m", ".c", ".h",
    ".svg", ".obj", ".stl", ".ply", ".off", ".gcode", "~", ".bak", ".old", ".orig", ".tmp", ".part",
)  # fmt: skip
_MAX_LINE = 100_000  # characters; the csv module takes no longer cell
_PROBE_SIZE = 1 << 17  # [bytes] by which the encoding is found: a choice
_MIN_UTF16 = 8  # [bytes], beyond which a text can be recognised as UTF-16: a choice
_UTF16_PROBE = 200  # [bytes] whose every second one is zero in UTF-16: a choice
_BYTE_ORDER_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
# Two characters of Shift-JIS whose first bytes are kana or usual kanji: rare signs in Windows-1252.
_JAPANESE = re.compile(rb"(?:[\x81-\x9f][\x40-\x7e\x80-\xfc]){2}")
# The time of day that the monitor of a serial line writes before it: "12:30:01.250 -> 84213", "[12:30:01.250] 84213".
_STAMP_OF_MONITOR = re.compile(r"^\[?((?:[\d/.-]+ )?\d{1,2}:\d{2}:\d{2}[.,]\d{3})(?: ->|\])[ \t]*", re.MULTILINE)
_SEPARATORS = "\t;,"
_HEAD_CHARACTERS = 1 << 14  # in which a stamp of a monitor is looked for: a choice
_SIGNATURES = {  # first bytes of files that are named like a text, but are not texts
    b"PK\x03\x04": "a zip archive and no text: a workbook is named .xlsx, an archive is unpacked first",
    b"\xd0\xcf\x11\xe0": "an old Excel workbook and no text: save it as .xlsx or .csv",
    b"\x1f\x8b": "a gzip archive and no text: name it .csv.gz",
    b"%PDF": "a PDF and no text: export the numbers as .csv",
    b"\x89PNG": "a picture and no text: export the numbers as .csv",
    b"\x89HDF": "an HDF5 file and no text: name it .h5",
    b"PAR1": "a Parquet file and no text: name it .parquet",
    b"\x93NUMPY": "an array of NumPy and no text: name it .npy",
    b"TDSm": "a TDMS file and no text: export it as .csv",
    b"SQLite format 3": "a database and no text: a bag of ROS 2 is named .db3",
}
_NO_TEXT = re.compile("[\x00-\x08\x0e-\x1f\x7f-\x9f\ufffe\uffff]")


def encoding_of(path: Path) -> str:
    """Return the encoding of a text: by its byte order mark, UTF-8 if it is valid, Shift-JIS, else Windows-1252."""
    opener = gzip.open if path.suffix.lower() == ".gz" else open
    with opener(path, "rb") as file:
        head = file.read(_PROBE_SIZE)
    for mark, encoding in _BYTE_ORDER_MARKS:
        if head.startswith(mark):
            # A mark within the text is damage, which the reader of UTF-8 reports. Looked at is what follows the mark
            # (2 or 3 bytes), without the last byte, which may be half a character.
            has_other_marks = "\ufeff" in head[2:-1].decode(encoding.removesuffix("-sig"), "ignore")
            return "utf-8" if has_other_marks else encoding
    # UTF-16 without a mark: the upper byte of each character is zero.
    for zero_index, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
        upper_bytes = head[zero_index:_UTF16_PROBE:2]
        lower_bytes = head[1 - zero_index : _UTF16_PROBE : 2]
        if len(head) > _MIN_UTF16 and not any(upper_bytes) and all(lower_bytes):
            return encoding
    if _is_text(head, "utf-8"):
        return "utf-8"
    if _JAPANESE.search(head) and _is_text(head, "cp932"):
        return "cp932"
    is_western = _is_text(head, "cp1252") and not _NO_TEXT.search(head.decode("cp1252"))
    return "cp1252" if is_western else "utf-8"  # whose reader reports the first byte that is not valid


def _is_text(head: bytes, encoding: str) -> bool:
    """Return True for bytes that are text in an encoding; the last character may be cut."""
    try:
        codecs.getincrementaldecoder(encoding)().decode(head)
    except UnicodeDecodeError:
        return False
    return True


@contextmanager
def open_text(path: Path, encoding: str | None = None, sheet: str | None = None) -> Iterator[IO[str]]:
    """Open a file as text, plain, gzipped or a workbook; raises LogError for a damaged one, also while it is read."""
    regular(path)
    if is_binary_table(path):
        yield io.StringIO(binary_table_text(path, sheet), newline="")
        return
    try:
        text_encoding = encoding or encoding_of(path)
        if path.suffix.lower() == ".gz":
            with gzip.open(path, "rt", encoding=text_encoding, newline="") as file:
                yield file
        else:
            with path.open(newline="", encoding=text_encoding) as file:
                yield _separate_stamps(file)
    except (OSError, *DAMAGED) as error:
        raise LogError(f"{path}: cannot be read: {error}") from error
    except UnicodeError as error:
        raise LogError(f"{path}: {_problem_with_text(path, encoding, error)}") from error
    except csv.Error as error:
        raise LogError(f"{path}: is not a CSV text: {error}") from error


def _separate_stamps(file: IO[str]) -> IO[str]:
    """Return a text with a separator behind the stamps of a serial monitor: that which most of its lines have."""
    head = file.read(_HEAD_CHARACTERS)
    file.seek(0)
    if "->" not in head and "]" not in head:  # one of which ends each stamp: the search below takes longer
        return file
    lines = [head[match.end() :].partition("\n")[0] for match in _STAMP_OF_MONITOR.finditer(head)]
    if not lines or 2 * len(lines) < head.count("\n"):
        return file
    counts = {mark: sum(mark in line for line in lines) for mark in _SEPARATORS}
    most_frequent = max(counts, key=counts.__getitem__)
    separator = most_frequent if 2 * counts[most_frequent] > len(lines) else " "
    return io.StringIO(_STAMP_OF_MONITOR.sub(rf"\g<1>{separator}", file.read()), newline="")


def _problem_with_text(path: Path, encoding: str | None, error: UnicodeError) -> str:
    """Return the kind of a file that is not a text, by its first bytes, with the remedy."""
    with path.open("rb") as file:
        head = file.read(_PROBE_SIZE)
    for signature, description in _SIGNATURES.items():
        if head.startswith(signature):
            return f"is {description}"
    if encoding is not None:
        return f"is not a text in {encoding}: state another encoding, or none"
    if _NO_TEXT.search(head.decode("latin-1")):
        return "is a binary file and no text: export its numbers as .csv"
    place = f" (byte {error.start})" if isinstance(error, UnicodeDecodeError) else ""
    return f"is a text of mixed encodings{place}: state one, as in --set device.log.encoding=cp1252"


def bounded_lines(file: IO[str], path: Path) -> Iterator[str]:
    """Yield the lines of a text; raises LogError for one that is too long to be a row of numbers."""
    while line := file.readline(_MAX_LINE):
        if len(line) == _MAX_LINE and not line.endswith("\n"):
            raise LogError(f"{path}: is not a CSV text: a line has more than {_MAX_LINE} characters")
        yield line
