"""What a CSV file contains: which columns are time, force, position and velocity, in which units; a ready pipeline."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Batch, Floats, LogError
from palpate_kit.logs.field_statistics import FieldStatistics
from palpate_kit.logs.readings import LATEST, SECOND, nanoseconds, si_unit
from palpate_kit.logs.recording import Suggestion, Survey, TopicSurvey
from palpate_kit.logs.role_guess import ROLES, NumberColumn, RoleGuess
from palpate_kit.logs.suggestion import assemble_suggestion, find_roles

from palpate_logs.csv_clock import NAMES, RATES, TimeColumn, clock_of
from palpate_logs.csv_sheet import Sheet, column_text, together
from palpate_logs.csv_truncation import cut_number
from palpate_logs.csv_units import DIMENSIONS, units_of

_ROWS = 400_000  # that are looked into
_PAUSE = 10.0  # usual intervals that make a gap
_WORDS = {
    "force": ("force", "f", "fz", "f_z", "force_z", "forcez", "fn", "load"),
    "position": ("position", "pos", "z", "pos_z", "posz", "height", "depth", "displacement", "penetration"),
    "velocity": ("velocity", "vel", "v", "vz", "v_z", "vel_z", "velz", "speed"),
    "time": NAMES,
}
_NICE = (20, 25, 50, 60, 80, 100, 120, 125, 200, 250, 300, 400, 500, 600, 800, 1000, 1200, 1500, 2000, 2500, 4000, 5000)
_USUAL = 500.0  # [Hz] by which the rest at the beginning is looked for where no rate is known
_NEAR = 0.05  # by which a rate found from the numbers may miss one of those


@dataclass(frozen=True)
class _SheetRoles:
    """A file, looked into."""

    sheet: Sheet
    values: Floats
    clock: TimeColumn | None

    def series(self) -> list[NumberColumn]:
        """Every column but the time, with its role by its unit or name."""
        names = self.sheet.names
        time = self.clock.seconds if self.clock else np.arange(len(self.values), dtype=float)
        found: list[NumberColumn] = []
        for k, name in enumerate(names):
            if self.clock is not None and k == self.clock.column:
                continue
            unit = self.sheet.unit(k)
            role = DIMENSIONS.get(si_unit(unit)[0], "other") if unit else _role_by_name(name)
            why = f"in {unit}" if unit else "by its name" if role else ""
            label = f"column {column_text(self.sheet.column(k))}"
            if role != "time" and not _counts(self.values[:, k]):
                found.append(NumberColumn(label, time, self.values[:, k], role, why, unit, ("", str(k))))
        return found


def _role_by_name(name: str) -> str | None:
    return next((role for role, words in _WORDS.items() if name.strip().lower() in words), None)


def _counts(values: Floats) -> bool:
    """Whether a column merely counts the rows."""
    return len(values) > 2 and bool((np.diff(values) == 1).all())


def _look(path: Path, choices: Mapping[str, str]) -> _SheetRoles:
    sheet = Sheet.of(path)
    values = together(sheet.blocks(), _ROWS)
    return _SheetRoles(sheet, values, clock_of(sheet, values, choices))


def survey_csv(path: Path) -> Survey:
    """What a CSV file contains: its rows, their rate, and what its columns may be."""
    looked = _look(path, {})
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
    kind = f"{len(sheet.names)} columns, {'a header' if sheet.header else 'no header'}, {sheet.delimiter!r} between"
    notes: tuple[str, ...] = (
        () if clock else ("no column is the time: give the rate, --rate '500 Hz', or the column, --time",)
    )
    if (cut := cut_number(path, sheet.delimiter)) is not None:
        notes += (
            f"the file was cut within its last number, {cut}: its line has no end, all numbers above have more digits",
        )
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


def tables_csv(path: Path) -> Iterator[tuple[str, tuple[str, ...], Batch]]:
    """Every row that has a time, in blocks, as recorded; raises LogError where no column is the time."""
    looked = _look(path, {})
    sheet, clock = looked.sheet, looked.clock
    if clock is None or clock.column is None:
        raise LogError(f"{path}: no column is the time (there are: {sheet.columns})")
    scale = si_unit(str(clock.setting["time"]["unit"]))[1]
    for block in sheet.blocks():
        with np.errstate(invalid="ignore", over="ignore"):
            rows = np.abs(block[:, clock.column] * scale) < LATEST
        stamps = nanoseconds(block[rows, clock.column] * scale)
        yield path.name, sheet.names, Batch(path.name, stamps, stamps, block[rows])


def suggest_csv(path: Path, choices: Mapping[str, str]) -> Suggestion:
    """Tables that read a CSV file; raises LogError where nothing in it can be a force or a position."""
    looked = _look(path, choices)
    sheet, clock = looked.sheet, looked.clock
    series = looked.series()
    chosen = {role: _chosen(sheet, series, role, choices[role]) for role in ROLES if role in choices}
    found = find_roles(series, chosen)
    if found is None:
        there = sheet.columns
        raise LogError(f"{path}: no two columns can be force and position; choose with --force, --position ({there})")
    units, doubts = units_of(found, clock is not None)
    factors = {role: si_unit(unit)[1] for role, unit in units.items()}
    device: dict[str, Any] = {"type": "csv-replay", "file": str(path)}
    extra: dict[str, list[str]] = {"reasons": [], "doubts": doubts, "blanks": [], "hints": []}
    rate = None
    if clock is not None:
        device |= clock.setting
        extra["reasons"] += [f"time: {clock.reason}"] if clock.reason else []
        if not clock.sure:
            column = f"column {column_text(sheet.column(clock.column or 0))}"
            doubts.append(f"time: {column} is a guess: it grows evenly ({clock.reason}); --time or --rate sets it")
    else:
        rate = _rate(found, factors, extra)
        device["rate"] = "? Hz" if rate is None else f"{rate:g} Hz"
    if sheet.delimiter != ",":
        device["delimiter"] = sheet.delimiter
    columns = {role: int(pick.series.key[1]) for role, pick in found.picks.items()}
    device["columns"] = {role: {"column": sheet.column(k), "unit": units[role]} for role, k in columns.items()}
    channels = {role: f"log.{role}" for role in found.picks}
    return assemble_suggestion(
        found, device, channels, factors, extra, 1.0 if clock is not None else 1.0 / (rate or _USUAL)
    )


def _rate(found: RoleGuess, factors: Mapping[str, float], extra: Mapping[str, list[str]]) -> float | None:
    """The rate of a file that does not state it: by the velocity, where it is the slope of the position."""
    if found.gain:
        rate = abs(found.gain) * factors["velocity"] / factors["position"]
        nice = min(_NICE, key=lambda r: abs(np.log(r / rate)))
        rate = nice if abs(nice / rate - 1.0) < _NEAR else float(f"{rate:.3g}")
        if RATES[0] <= rate <= RATES[1]:
            extra["doubts"].append(
                f"rate: {rate:g} Hz is a guess: nothing states it, but at this rate the velocity is the slope of the "
                "position; --rate sets it"
            )
            return rate
    extra["blanks"].append("rate: rows per second; nothing in the file states it (or --rate '500 Hz')")
    return None


def _chosen(sheet: Sheet, series: Sequence[NumberColumn], role: str, text: str) -> NumberColumn:
    k = sheet.index_of(role, text.removeprefix(":"))
    for mine in series:
        if mine.key[1] == str(k):
            return replace(mine, role=role, why="chosen")
    raise LogError(f"{sheet.path}: --{role}: column {column_text(text)} is the time, or counts the rows")
