"""The contents of a table: its rows, their rate, and what its columns may be."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from palpate import Batch, LogError
from palpate_kit.logs.suggestion import find_roles
from palpate_records.field_statistics import FieldStatistics
from palpate_records.messages.readings import LATEST, SECOND, nanoseconds, si_unit
from palpate_records.recording import Survey, TopicSurvey
from palpate_records.tables.clock_times import CLOCK
from palpate_records.tables.csv_layout import facts_worth_stating
from palpate_records.tables.csv_truncation import cut_number
from palpate_records.tables.table_records import records_note

from palpate_logs.csv_roles import look

_PAUSE = 10.0  # usual intervals that make a gap


def survey_csv(path: Path) -> Survey:
    """What a CSV file contains: its rows, their rate, and what its columns may be."""
    looked = look(path, {})
    sheet, clock = looked.sheet, looked.clock
    found = find_roles(looked.series(), {})
    may = {int(p.series.key[1]): role for role, p in found.picks.items()} if found else {}
    may |= {clock.column: "time"} if clock and clock.column is not None else {}
    columns = []
    gathered = FieldStatistics([f"{name}{f' ({may[k]}?)' if k in may else ''}" for k, name in enumerate(sheet.names)])
    rows = 0
    for block in sheet.blocks():
        rows += len(block)
        gathered.add(block)
    columns = list(gathered.names)
    header, between = "a header" if sheet.header else "no header", repr(sheet.dialect.delimiter)
    kind = f"{len(sheet.names)} columns, {header}, {between} between"
    notes: tuple[str, ...] = (
        () if clock else ("no column is the time: give the rate, --rate '500 Hz', or the column, --time",)
    )
    if (cut := cut_number(path, sheet.dialect.delimiter, sheet.dialect.decimal)) is not None:
        notes += (
            f"the file was cut within its last number, {cut}: its line has no end, all numbers above have more digits",
        )
    notes += (note,) if (note := records_note(path, {})) is not None else ()
    notes += tuple(f"line {fact.line}: {fact.name}: {fact.value}" for fact in facts_worth_stating(sheet.facts))
    if clock is None:
        numbers = gathered.surveys()
        topic = TopicSurvey(path.name, kind, "csv", rows, 0, 0, fields=tuple(columns), numbers=numbers)
        return Survey(path, "CSV", (topic,), notes)
    stamps = nanoseconds(clock.seconds[np.abs(clock.seconds) < LATEST])
    steps = np.diff(np.sort(stamps)).astype(np.float64) / SECOND
    low, usual, high = (float(p) for p in np.percentile(steps, (1, 50, 99))) if len(steps) else (0.0, 0.0, 0.0)
    topic = TopicSurvey(
        path.name,
        kind,
        "csv",
        rows,
        int(stamps.min()),
        int(stamps.max()),
        (low, usual, high),
        int(np.count_nonzero(steps > _PAUSE * usual)),
        float(steps.max(initial=0.0)),
        None,
        tuple(columns),
        gathered.surveys(),
    )
    return Survey(path, "CSV", (topic,), notes)


def tables_csv(path: Path, notes: list[str] | None = None) -> Iterator[tuple[str, tuple[str, ...], Batch]]:
    """Yield every row that has a time, in blocks, as recorded; raises LogError where no column is the time."""
    looked = look(path, {})
    sheet, clock = looked.sheet, looked.clock
    if clock is None or clock.column is None:
        raise LogError(f"{path}: no column is the time (there are: {sheet.columns})")
    unit = CLOCK if clock.column in sheet.layout.clocks else sheet.unit(clock.column) or "s"
    unit = str(clock.setting["time"]["unit"]) if "time" in clock.setting else unit
    scale = 1.0 if unit == CLOCK else si_unit(unit)[1]
    untimed = 0
    for block in sheet.blocks():
        with np.errstate(invalid="ignore", over="ignore"):
            rows = np.abs(block[:, clock.column] * scale) < LATEST
        untimed += int(np.count_nonzero(~rows))
        stamps = nanoseconds(block[rows, clock.column] * scale)
        yield path.name, sheet.names, Batch(path.name, stamps, stamps, block[rows])
    if untimed and notes is not None:
        notes.append(f"{untimed} rows have no finite time, and were left out")
