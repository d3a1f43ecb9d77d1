"""``curves.csv``: the curves of a folder with their files, facts and groups: sample, site, day, ..."""

from __future__ import annotations

import csv
import io
import json
import os
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path

from palpate import LogError, suggest
from palpate_engine import DIALECT, write_whole

from palpate_kit.curves.curve import Curve

LIST = "curves.csv"
CURVE, FILE, RECORD = "curve", "file", "record"  # the last for a file of several records
_MAX_HEAD = 1 << 16  # [characters] that are read of the line of column names: a choice
PLACES = ("x_m", "y_m")
OWN = (CURVE, FILE, RECORD, DIALECT)  # columns that palpate writes
FACTS = {  # columns, and the facts that they state
    **{key: key for key in ("tip", "tip_uncertainty", "thickness", "base", "delay", "tare", "tip_mass", "poisson")},
    **{key: key for key in ("inclination", "mount", "beam", "truth")}, "position_of": "position",
}  # fmt: skip
Entries = dict[str, dict[str, str]]  # cells by column, by the name of the curve


def read_list(path: Path, known: Collection[str] | None = None) -> Entries:
    """Return the cells of every curve in a list (``curves.csv``) by column; none without the file.

    Its first line names the columns. Raises LogError for a table without a column `curve`, a row with more cells than
    columns, a curve that is listed twice, or one without a file that is not among the `known`.
    """
    if not path.is_file():
        return {}
    rows = _csv_rows(path)
    head = _list_head(path, rows[0] if rows else [])
    entries: Entries = {}
    for number, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) > len(head):
            raise LogError(f"{path}:{number}: has {len(row)} cells for {len(head)} columns")
        # Spreadsheets drop empty cells at the end of a row.
        padded_row = (*row, *[""] * (len(head) - len(row)))
        cells = {column: cell.strip() for column, cell in zip(head, padded_row, strict=True)}
        name = cells.pop(CURVE)
        if name in entries:
            raise LogError(f"{path}:{number}: the curve {name!r} is there twice")
        if known is not None and name not in known and not cells.get(FILE):
            raise LogError(f"{path}:{number}: no curve {name!r}{suggest(name, known)}")
        entries[name] = cells
    return entries


def _csv_rows(path: Path) -> list[list[str]]:
    """Return the cells of a text table; raises LogError for one that cannot be read."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            return list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise LogError(f"{path}: cannot be read: {error}") from error


def _list_head(path: Path, row: Sequence[str]) -> list[str]:
    """Return the columns of a list of curves; raises LogError without a column `curve`, or for two of one name."""
    head = [name.strip() for name in row]
    if CURVE not in head:
        raise LogError(f"{path}: has no column {CURVE!r}{suggest(CURVE, head)}")
    if twice := next((name for name in head if head.count(name) > 1), None):
        raise LogError(f"{path}: has the column {twice!r} twice")
    return head


def write_list(path: Path, entries: Mapping[str, Mapping[str, str]]) -> None:
    """Write the cells of every curve; raises OutputError."""
    stated_columns = [column for cells in entries.values() for column in cells]
    file_columns = [name for name in OWN if name != RECORD or name in stated_columns]
    columns = dict.fromkeys((*file_columns, *stated_columns))
    text = io.StringIO()
    table = csv.DictWriter(text, columns, lineterminator="\n", restval="")
    table.writeheader()
    table.writerows({CURVE: name, **cells} for name, cells in entries.items())
    write_whole(path, text.getvalue())


def add_curves(
    folder: Path,
    curves: Sequence[Curve],
    dialect: str,
    more: Mapping[str, Mapping[str, str]] = {},
    base: Path | None = None,
) -> None:
    """Enter the curves that have a file in the list of a folder, with `more` cells of some; other cells are kept.

    `dialect` is the name of the pipeline that reads their files; that of the folder's first one is "". Files are
    relative to the folder, or to a `base`, so that both can be moved together. Raises LogError, OutputError.
    """
    entries = read_list(folder / LIST)
    before = {name: dict(cells) for name, cells in entries.items()}  # a copy, to see whether anything changes
    for curve in curves:
        if not curve.file:
            continue
        file = os.path.relpath(Path(curve.file).resolve(), (base or folder).resolve())
        record = {} if curve.record is None else {RECORD: curve.record}
        cells = entries.setdefault(curve.name, {})
        cells |= {FILE: file, **record, DIALECT: dialect, **more.get(curve.name, {})}
    if entries != before:
        write_list(folder / LIST, entries)


def stated_in(cells: Mapping[str, str]) -> dict[str, str]:
    """Return the facts that the cells of a curve state, by their keys; a position of the tip has no beam behind it."""
    facts = {key: cells[name] for name, key in FACTS.items() if cells.get(name)}
    return {"beam": "none", **facts} if facts.get("position") == "tip" else facts


def fact_assignments(cells: Mapping[str, str]) -> tuple[str, ...]:
    """Return the facts that the cells of a curve state, as settings of this curve alone."""
    return tuple(f"rig.{key}={json.dumps(text)}" for key, text in stated_in(cells).items())


def cells_beside(sources: Sequence[Path], curves: Iterable[Curve]) -> Entries:
    """Return the cells of curves in ``curves.csv`` next to their files, or in a folder above them among the sources.

    A list names a curve by its file relative to the folder of the list, followed by its record if it has rows for
    single records, or by the file's name without its ending. Raises LogError.
    """
    folders = dict.fromkeys(source if source.is_dir() else source.parent for source in sources)
    lists = {folder.resolve(): read_list(folder / LIST) for folder in folders if is_list(folder / LIST)}
    entries: Entries = {}
    for curve in curves:
        file = Path(curve.file)
        for folder, listed in lists.items():
            name = file.relative_to(folder) if file.is_relative_to(folder) else file
            cells = listed.get(f"{name}:{curve.record}") or listed.get(str(name)) or listed.get(name.stem) or {}
            entries.setdefault(curve.name, {}).update((key, cell) for key, cell in cells.items() if key not in OWN)
    return entries


def fact_counts(facts: Iterable[Collection[str]], curves: int) -> str:
    """Return a line on the `facts` of each curve that ``curves.csv`` states, of so many; empty if it states none."""
    counts = Counter(key for facts_of_curve in facts for key in FACTS.values() if key in facts_of_curve)
    # In the order of the facts, whichever curve comes first.
    list_of_counts = ", ".join(f"{key} of {counts[key]}" for key in dict.fromkeys(FACTS.values()) if counts[key])
    return f"curves.csv states {list_of_counts} of {curves} curves" if list_of_counts else ""


def is_list(path: Path) -> bool:
    """Return True if a file is a list of curves: it is called ``curves.csv`` and has a column `curve`."""
    if path.name != LIST or not path.is_file():
        return False
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        return CURVE in [cell.strip() for cell in file.readline(_MAX_HEAD).split(",")]


def add_groups(folder: Path, table: Path, known: Collection[str]) -> None:
    """Copy the columns of another table into the list of a folder; raises LogError for an unknown curve."""
    if not table.is_file():
        raise LogError(f"{table}: no such file")
    entries, more = read_list(folder / LIST), read_list(table)
    if unknown := next((name for name in more if name not in known), None):
        raise LogError(f"{table}: no curve {unknown!r}{suggest(unknown, known)}")
    for name, cells in more.items():
        entries.setdefault(name, {}).update((key, cell) for key, cell in cells.items() if key not in OWN)
    write_list(folder / LIST, entries)


def columns_of(curves: Iterable[Mapping[str, str]]) -> list[str]:
    """Return the columns by which curves with such cells can be grouped, in their order."""
    names: Iterable[str] = (column for cells in curves for column in cells)
    return [name for name in dict.fromkeys(names) if name not in OWN]
