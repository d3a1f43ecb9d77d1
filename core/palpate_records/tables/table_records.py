"""Several records in one table file: sheets, tables under each other or side by side, a column that names them."""

from __future__ import annotations

import io
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from itertools import chain, islice
from pathlib import Path
from typing import IO

from palpate import LogError, printable, suggest

from palpate_records.messages.readings import si_unit
from palpate_records.tables.binary_tables import is_binary_table, record_sheets
from palpate_records.tables.cells import number
from palpate_records.tables.csv_names import exact_role, role_by_words, unit_of, words_of
from palpate_records.tables.csv_sheet import Sheet
from palpate_records.tables.plain_numbers import whole_lines, without_digits
from palpate_records.tables.table_pages import continued_pages
from palpate_records.tables.table_record import TableRecord
from palpate_records.tables.table_text import bounded_lines, open_text

RECORD = "record"  # what names one of them among the keys that can be stated
_NAME = 40  # characters of a record's name
_MOST = 2000  # records of a file
_SHOWN = 6  # records that are named
_ROWS = 20  # of a record that a column names, usually
_FILES = 8  # whose records are remembered
_SHEETS = 1 << 14  # that are remembered, 2 kB each: a folder is gone through twice
_WORDS = (
    "point points site press specimen specimens sample probe trial indent slot gel curve replicate probekörper messung "
    "punkt muestra numune échantillon",
    "raw filtered smooth smoothed corrected target actual desired setpoint command commanded cmd reference measured "
    "approach retract extend loading unloading left right x y z rx ry rz tcp joint robot",
)
# What names records; what says the same of one twice, or is a component of a vector.
_NAMING, _OTHER = (frozenset(words.split()) for words in _WORDS)
_DIMENSIONS = {"N": "force", "m": "position"}
_BRACKETS = re.compile(r"[\[(][^\])]*[\])]")


def records_in(path: Path, stated: Mapping[str, str] | None = None) -> tuple[TableRecord, ...]:
    """Return the records of a file that holds several, by what is stated of how it is written; none where it is one."""
    records = _parts_of(path, stated or {})
    return records if len(records) > 1 else ()


def pages_of(path: Path, stated: Mapping[str, str | int]) -> int:
    """Return through how many tables under each other the only record goes on, or that of a stated header."""
    texts = {key: str(value) for key, value in stated.items()}
    header = texts.pop("header", None)
    records = [one for one in _parts_of(path, texts) if header is None or str(one.header) == header]
    return records[0].pages if len(records) == 1 else 1


def _parts_of(path: Path, stated: Mapping[str, str]) -> tuple[TableRecord, ...]:
    """Return the records of a file, also the only one if it is in pages."""
    about = path.stat()
    return _records(path, tuple(sorted(stated.items())), about.st_mtime_ns, about.st_size)


def record_named(path: Path, name: str, stated: Mapping[str, str] | None = None) -> TableRecord:
    """Return the record of a name; raises LogError if it is missing."""
    there = records_in(path, stated)
    for record in there:
        if record.name == name:
            return record
    known = [record.name for record in there]
    raise LogError(f"{path}: no record {name!r}{suggest(name, known) if known else ': it is one'}")


def records_note(path: Path, stated: Mapping[str, str]) -> str | None:
    """That a file holds several records, none of which is stated; None where it is one."""
    names = [] if RECORD in stated else [record.name for record in records_in(path, stated)]
    if not names:
        return None
    more = ", ..." if len(names) > _SHOWN else ""
    return f"the file holds {len(names)} records ({', '.join(names[:_SHOWN])}{more}): record = NAME reads one of them"


def sheet_of(path: Path, stated: Mapping[str, str] | None = None) -> Sheet:
    """How a file is written, or the record of it that is stated; raises LogError."""
    given = dict(stated or {})
    name = given.pop(RECORD, None)
    if name is not None:
        return Sheet.of(path, given, record_named(path, name, given))
    return replace(_sheet(path, given), pages=pages_of(path, given))


def _sheet(path: Path, given: Mapping[str, str]) -> Sheet:
    """How a file is written that is one record."""
    about = path.stat()
    return _sheet_at(path, tuple(sorted(given.items())), about.st_mtime_ns, about.st_size)


@lru_cache(_SHEETS)
def _sheet_at(path: Path, stated: tuple[tuple[str, str], ...], changed: int, size: int) -> Sheet:
    return Sheet.of(path, dict(stated))


@lru_cache(_FILES)
def _records(path: Path, stated: tuple[tuple[str, str], ...], changed: int, size: int) -> tuple[TableRecord, ...]:
    given = dict(stated)
    found: list[TableRecord] = []
    if is_binary_table(path) and "sheet" not in given:
        sheets = record_sheets(path)
        for sheet in sheets if len(sheets) > 1 else ():
            inner = _in_table(path, {**given, "sheet": sheet})
            found += [replace(one, name=f"{sheet}:{one.name}", sheet=sheet) for one in inner if len(inner) > 1]
            found += [replace(one, name=sheet, sheet=sheet) for one in inner or [TableRecord(sheet)] if len(inner) < 2]
    found = found or _in_table(path, given)
    if len(found) > _MOST:
        raise LogError(f"{path}: holds {len(found)} records; {_MOST} are read at most: split the file")
    return tuple(found)


def _in_table(path: Path, given: Mapping[str, str]) -> list[TableRecord]:
    """Return the records in one text or sheet, none or one in pages where it is one; LogError is for whoever reads
    it."""
    with suppress(LogError):
        sheet = _sheet(path, given)
        if sheet.header and len(sheet.names) > 1:
            stacked = [] if "header" in given else _stacked(sheet)
            return stacked or _side_by_side(sheet) or _by_column(sheet)
    return []


def _stacked(sheet: Sheet) -> list[TableRecord]:
    """Tables under each other that have the same names, by the title above each."""
    names, found, title = [name.strip() for name in sheet.names], list[tuple[int, str]](), ""
    with open_text(sheet.path, *sheet.text_keys) as file:
        for line, text in _lines_with_letters(file, sheet):
            cells = [cell.strip() for cell in next(iter(sheet.dialect.rows([text])), [])]
            if cells == names:
                found.append((line, title))
                title = ""
            elif sum(map(bool, cells)) == 1:
                title = printable("".join(cells))[:_NAME]
    return _without_page_breaks(sheet, found) if len(found) > 1 else []


def _without_page_breaks(sheet: Sheet, tables: Sequence[tuple[int, str]]) -> list[TableRecord]:
    """Records of tables with the same names, by line and title: a table that goes on with the one above is left out."""
    roles = [_role(sheet, k) for k in range(len(sheet.names))]
    continued = [False] * len(tables)
    if "time" in roles:
        time = roles.index("time")
        signals = [k for k, role in enumerate(roles) if role in _DIMENSIONS.values()]
        others = [k for k in sorted(sheet.layout.numbers) if k != time]
        with open_text(sheet.path, *sheet.text_keys) as file:
            continued = continued_pages(sheet, [line for line, _ in tables], time, signals or others, file)
    records = list[TableRecord]()
    for (line, title), goes_on in zip(tables, continued, strict=True):
        if goes_on and not _NAMING & {*words_of(title)}:  # "Specimen 2" states a record, whatever its time
            records[-1] = replace(records[-1], pages=records[-1].pages + 1)
        else:
            records.append(TableRecord(title or str(len(records) + 1), header=line))
    if len({record.name for record in records}) < len(records):
        records = [replace(record, name=str(k)) for k, record in enumerate(records, 1)]
    return records


def _lines_with_letters(file: IO[str], sheet: Sheet) -> Iterator[tuple[int, str]]:
    """Yield the lines that hold a letter, with their numbers from 1 on."""
    above = [*islice(bounded_lines(file, sheet.path), sheet.layout.begin)]
    count = 0
    for text in chain(above, whole_lines(file)):
        lines = [*io.StringIO(text, newline="")]
        # Whole blocks of numbers have no letter but the e of an exponent.
        are_exponents = all(text.count(mark) == text.count(f"{mark}-") + text.count(f"{mark}+") for mark in "eE")
        if not are_exponents or any(map(str.isalpha, {*without_digits(text)})):
            yield from ((count + k, line) for k, line in enumerate(lines, 1) if any(map(str.isalpha, line)))
        count += len(lines)


def _side_by_side(sheet: Sheet) -> list[TableRecord]:
    """Tables side by side, each with a force and a position of its own; columns without a label belong to all."""
    marks = [_label_of(sheet, k) for k in range(len(sheet.names))]
    shared = [k for k, (label, _) in enumerate(marks) if not label]
    labels = list(dict.fromkeys(label for label, _ in marks if label))
    if len(labels) < 2 or any(_role(sheet, k) in _DIMENSIONS.values() for k in shared):
        return []
    words = [{*words_of(label)} for label in labels]
    if any(_OTHER & some and not _NAMING & some for some in words) or labels == [str(k) for k in range(len(labels))]:
        return []
    found = []
    for label in labels:
        own = [k for k, (mine, _) in enumerate(marks) if mine == label]
        roles = Counter(_role(sheet, k) for k in own)
        if roles["force"] != 1 or roles["position"] != 1:
            continue
        cells = tuple(sorted([*shared, *own]))
        names = tuple(marks[k][1] for k in cells)
        unique = len({*names}) == len(names)
        found.append(TableRecord(label[:_NAME], cells=cells, names=names if unique else tuple(map(str, cells))))
    return found if len(found) > 1 else []


def _label_of(sheet: Sheet, k: int) -> tuple[str, str]:
    """What a column is called besides its quantity, and the name without that; no label where nothing is."""
    name, group = sheet.names[k], sheet.layout.groups[k] if k < len(sheet.layout.groups) else ""
    if group:
        return printable(group), name.removeprefix(group).strip() or name
    if sheet.names.count(name) > 1:
        return str(sheet.names[:k].count(name) + 1), name
    role, unit = _role(sheet, k), sheet.unit(k)
    if role is None or (unit is None and not _NAMING & {*words_of(name)}):
        return "", name
    bare = _BRACKETS.sub(" ", name)
    bare = re.sub(rf"[\s_/,]*{re.escape(unit)}\s*$", "", bare) if unit else bare
    rest = [word for word in re.split(r"[\s_\-:,]+", bare) if word and not _states(word, role)]
    label = " ".join(rest)
    if not re.fullmatch(r".*\d|[A-Za-z]", label) or (len(rest) == 1 and rest[0].lower() in ("x", "y", "z")):
        return "", name
    plain = name
    for word in rest:
        plain = re.sub(rf"[\s_\-:,]*(?<![^\W_]){re.escape(word)}(?![^\W_])", " ", plain, count=1)
    return label, " ".join(plain.split()).strip("_- ")


def _states(word: str, role: str) -> bool:
    """Return True if a word of a name, with or without the number behind it, is that of its quantity."""
    return role in (exact_role(word), role_by_words(word))


def _role(sheet: Sheet, k: int) -> str | None:
    """What a column is: a force, a position, the time, or something else."""
    name, unit = sheet.names[k], _stated_unit(sheet, k)
    by_unit = (_DIMENSIONS | {"s": "time"}).get(si_unit(unit)[0]) if unit else None
    return by_unit or exact_role(name) or role_by_words(name)


def _stated_unit(sheet: Sheet, k: int) -> str | None:
    """Return the unit by the name of a column, or the row of units."""
    return unit_of(sheet.names[k], sheet.layout.units[k] if k < len(sheet.layout.units) else "")


def _by_column(sheet: Sheet) -> list[TableRecord]:
    """Records that columns name by a text or a whole number in each row."""
    at = [
        k
        for k, name in enumerate(sheet.names)
        if _NAMING & {*words_of(name)} and _role(sheet, k) in (None, "other") and _stated_unit(sheet, k) is None
    ]
    if not at:
        return []
    with open_text(sheet.path, *sheet.text_keys) as file:
        lines = islice(bounded_lines(file, sheet.path), sheet.layout.begin, None)
        rows = sheet.dialect.rows(line for line in lines if not sheet.dialect.is_comment(line))
        current, counts = [""] * len(at), Counter[tuple[str, ...]]()
        for cells in rows:
            if sum(map(sheet.dialect.is_value, cells)) < 2:
                continue  # what is below the table names no record
            for i, k in enumerate(at):
                current[i] = (cells[k].strip() if k < len(cells) else "") or current[i]
            counts[tuple(current)] += 1
    used: tuple[int, ...] = ()
    for i in range(len(at)):
        finer = _merged(counts, (*used, i))
        if len(finer) > len(_merged(counts, used)) and _names_records(finer, sheet):
            used = (*used, i)
    merged = _merged(counts, used)
    if not used or len(merged) < 2:
        return []
    naming = tuple(at[i] for i in used)
    return [TableRecord(printable(" ".join(texts))[:_NAME], naming=naming, texts=texts) for texts in merged]


def _merged(counts: Mapping[tuple[str, ...], int], used: Sequence[int]) -> Counter[tuple[str, ...]]:
    found = Counter[tuple[str, ...]]()
    for texts, count in counts.items():
        found[tuple(texts[i] for i in used)] += count
    return found


def _names_records(counts: Mapping[tuple[str, ...], int], sheet: Sheet) -> bool:
    """Return True if texts are names: whole numbers, or no numbers; and most of them are those of many rows."""
    usual = sorted(counts.values())[len(counts) // 2]
    texts = {text for key in counts for text in key}
    numbers = [number(text, sheet.dialect.decimal) for text in texts if sheet.dialect.is_number(text)]
    return usual >= _ROWS and all(value % 1.0 == 0.0 for value in numbers) and ("",) not in counts
