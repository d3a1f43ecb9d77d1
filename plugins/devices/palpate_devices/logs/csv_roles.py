"""What a CSV file holds: which columns are time, force, position and velocity, in which units; a ready pipeline."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Batch, Floats, LogError, printable, to_si

from palpate_devices.logs.csv_end import cut_number
from palpate_devices.logs.csv_sheet import Sheet, together
from palpate_devices.logs.field_statistics import Gathered
from palpate_devices.logs.guess import ROLES, Found, Series
from palpate_devices.logs.readings import LATEST, SECOND, nanoseconds, si_unit
from palpate_devices.logs.suggesting import assembled, force_unit, length_unit, searched
from palpate_devices.recording import Suggestion, Survey, TopicSurvey

_ROWS = 400_000  # that are looked into
_PAUSE = 10.0  # usual intervals that make a gap
_RATES = (20.0, 5000.0)  # [Hz] of a recording, by which the unit of a time without one is told
_DIMENSIONS = {"N": "force", "m": "position", "m/s": "velocity"}
_WORDS = {
    "force": ("force", "f", "fz", "f_z", "force_z", "forcez", "fn", "load"),
    "position": ("position", "pos", "z", "pos_z", "posz", "height", "depth", "displacement", "penetration"),
    "velocity": ("velocity", "vel", "v", "vz", "v_z", "vel_z", "velz", "speed"),
    "time": ("time", "t", "stamp", "timestamp", "second", "seconds", "sec", "secs"),
}
_NAME, _NAMED = 40, 12  # characters of a column's name, and columns, that are shown
_NICE = (20, 25, 50, 60, 80, 100, 120, 125, 200, 250, 300, 400, 500, 600, 800, 1000, 1200, 1500, 2000, 2500, 4000, 5000)
_USUAL = 500.0  # [Hz] by which the rest at the beginning is looked for where no rate is known
_NEAR = 0.05  # by which a rate that was told from the numbers may miss one of those
_LIKE = 0.25  # by which a velocity may miss the slope of the position, of their units' ratio


@dataclass(frozen=True)
class Clock:
    """Where the time of a row comes from."""

    seconds: Floats  # (n,)
    setting: Mapping[str, Any] = field(default_factory=dict)  # of the device
    reason: str = ""
    column: int | None = None
    sure: bool = True


@dataclass(frozen=True)
class _Looked:
    """A file, looked into."""

    sheet: Sheet
    values: Floats
    clock: Clock | None

    def series(self) -> list[Series]:
        """Every column but the time, with what its unit or its name says that it is."""
        names = self.sheet.names
        time = self.clock.seconds if self.clock else np.arange(len(self.values), dtype=float)
        found: list[Series] = []
        for k, name in enumerate(names):
            if self.clock is not None and k == self.clock.column:
                continue
            unit = self.sheet.unit(k)
            role = _DIMENSIONS.get(si_unit(unit)[0], "other") if unit else _role_by_name(name)
            why = f"in {unit}" if unit else "by its name" if role else ""
            label = f"column {_shown(self.sheet.column(k))}"
            if role != "time" and not _counts(self.values[:, k]):
                found.append(Series(label, time, self.values[:, k], role, why, unit, ("", str(k))))
        return found


def _role_by_name(name: str) -> str | None:
    return next((role for role, words in _WORDS.items() if name.strip().lower() in words), None)


def _counts(values: Floats) -> bool:
    """Whether a column merely counts the rows."""
    return len(values) > 2 and bool((np.diff(values) == 1).all())


def _shown(column: int | str) -> str:
    return printable(str(column))[:_NAME]


def _there(sheet: Sheet) -> str:
    """The columns that there are, not more than a line can hold."""
    names = [_shown(name) for name in sheet.names[:_NAMED]]
    return ", ".join(names) + (", ..." if len(sheet.names) > _NAMED else "")


def _look(path: Path, choices: Mapping[str, str]) -> _Looked:
    sheet = Sheet.of(path)
    values = together(sheet.blocks(), _ROWS)
    return _Looked(sheet, values, _clock(sheet, values, choices))


def _clock(sheet: Sheet, values: Floats, choices: Mapping[str, str]) -> Clock | None:
    if "rate" in choices:
        try:
            rate = to_si(choices["rate"], "Hz")
        except ValueError as error:
            raise LogError(f"{sheet.path}: --rate: {error}") from error
        return Clock(np.arange(len(values)) / rate, {"rate": choices["rate"]}, "chosen")
    if "time" in choices:
        columns = [_index(sheet, "time", choices["time"])]
    else:
        columns = [k for k, name in enumerate(sheet.names) if _first_word(name) in _WORDS["time"]]
    named = len(columns)
    rest = [] if "time" in choices else [k for k in range(len(sheet.names)) if k not in columns]
    columns += [k for k in rest if _ticks(values[:, k])]
    for i, k in enumerate(columns):
        steps = np.diff(values[:, k])
        usual = float(np.median(steps)) if len(steps) else 0.0
        unit = sheet.unit(k) or next((u for u in ("s", "ms", "us", "ns") if usual > 0 and _plausible(usual, u)), None)
        if unit is None or si_unit(unit)[0] != "s":
            continue
        seconds = values[:, k] * si_unit(unit)[1]
        reason = f"taken as {unit}: {1.0 / (usual * si_unit(unit)[1]):.4g} Hz" if usual > 0 else f"in {unit}"
        return Clock(seconds, {"time": {"column": sheet.column(k), "unit": unit}}, reason, k, i < named)
    return None


def _first_word(name: str) -> str:
    """Up to a space, an underscore or a bracket."""
    ends = [at for at in map(name.find, "_ [(\t") if at >= 0]
    return name[: min(ends, default=len(name))].lower()


def _plausible(step: float, unit: str) -> bool:
    return _RATES[0] <= 1.0 / (step * si_unit(unit)[1]) <= _RATES[1]


def _ticks(values: Floats) -> bool:
    """Whether a column always grows, evenly, and does not merely count the rows."""
    steps: Floats = np.asarray(np.diff(values), np.float64)
    return bool(
        len(steps) > 10 and (steps > 0).all() and float(steps.std()) < 0.5 * float(steps.mean()) and (steps != 1).any()
    )


def _index(sheet: Sheet, role: str, choice: str) -> int:
    """The column that a choice names, by the header or by its number."""
    if choice in sheet.names:
        return sheet.names.index(choice)
    if choice.isdigit() and int(choice) < len(sheet.names):
        return int(choice)
    raise LogError(f"{sheet.path}: --{role}: there is no column {choice!r} (there are: {_there(sheet)})")


def survey_csv(path: Path) -> Survey:
    """What a CSV file holds: its rows, their rate, and what its columns may be."""
    looked = _look(path, {})
    sheet, clock = looked.sheet, looked.clock
    found = searched(looked.series(), {})
    may = {int(p.series.key[1]): role for role, p in found.picks.items()} if found else {}
    may |= {clock.column: "time"} if clock and clock.column is not None else {}
    columns = []
    gathered = Gathered([f"{name}{f' ({may[k]}?)' if k in may else ''}" for k, name in enumerate(sheet.names)])
    rows = 0
    for block in sheet.blocks():
        rows += len(block)
        gathered.add(block)
    columns = list(gathered.names)
    kind = f"{len(sheet.names)} columns, {'a header' if sheet.header else 'no header'}, {sheet.delimiter!r} between"
    notes: tuple[str, ...] = (
        () if clock else ("no column holds the time: give the rate, --rate '500 Hz', or the column, --time",)
    )
    if (cut := cut_number(path, sheet.delimiter)) is not None:
        notes += (f"the file was cut within its last number, {cut}: its line has no end, and all above it more digits",)
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
    """Every row that has a time, in blocks, as recorded; raises LogError where no column holds the time."""
    looked = _look(path, {})
    sheet, clock = looked.sheet, looked.clock
    if clock is None or clock.column is None:
        raise LogError(f"{path}: no column holds the time (there are: {_there(sheet)})")
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
    found = searched(series, chosen)
    if found is None:
        there = _there(sheet)
        raise LogError(f"{path}: no two columns can be force and position; choose with --force, --position ({there})")
    units, doubts = _units(looked, found)
    factors = {role: si_unit(unit)[1] for role, unit in units.items()}
    device: dict[str, Any] = {"type": "csv-replay", "file": str(path)}
    extra: dict[str, list[str]] = {"reasons": [], "doubts": doubts, "blanks": [], "hints": []}
    rate = None
    if clock is not None:
        device |= clock.setting
        extra["reasons"] += [f"time: {clock.reason}"] if clock.reason else []
        if not clock.sure:
            column = f"column {_shown(sheet.column(clock.column or 0))}"
            doubts.append(f"time: {column} is a guess: it grows evenly ({clock.reason}); --time or --rate says it")
    else:
        rate = _rate(found, factors, extra)
        device["rate"] = "? Hz" if rate is None else f"{rate:g} Hz"
    if sheet.delimiter != ",":
        device["delimiter"] = sheet.delimiter
    columns = {role: int(pick.series.key[1]) for role, pick in found.picks.items()}
    device["columns"] = {role: {"column": sheet.column(k), "unit": units[role]} for role, k in columns.items()}
    channels = {role: f"log.{role}" for role in found.picks}
    return assembled(found, device, channels, factors, extra, 1.0 if clock is not None else 1.0 / (rate or _USUAL))


def _rate(found: Found, factors: Mapping[str, float], extra: Mapping[str, list[str]]) -> float | None:
    """The rate of a file that does not say it: by the velocity, where it is the slope of the position."""
    if found.gain:
        rate = abs(found.gain) * factors["velocity"] / factors["position"]
        nice = min(_NICE, key=lambda r: abs(np.log(r / rate)))
        rate = nice if abs(nice / rate - 1.0) < _NEAR else float(f"{rate:.3g}")
        if _RATES[0] <= rate <= _RATES[1]:
            extra["doubts"].append(
                f"rate: {rate:g} Hz is a guess: nothing states it, but at this rate the velocity is the slope of the "
                "position; --rate says it"
            )
            return rate
    extra["blanks"].append(
        "rate: how many rows there are in a second; no number in the file says it (or --rate '500 Hz')"
    )
    return None


def _chosen(sheet: Sheet, series: Sequence[Series], role: str, text: str) -> Series:
    k = _index(sheet, role, text.removeprefix(":"))
    for mine in series:
        if mine.key[1] == str(k):
            return replace(mine, role=role, why="chosen")
    raise LogError(f"{sheet.path}: --{role}: column {_shown(text)} holds the time, or counts the rows")


def _units(looked: _Looked, found: Found) -> tuple[dict[str, str], list[str]]:
    """Units as the header says, else the likeliest; and which of them are guesses."""
    units = {
        r: p.series.unit
        for r, p in found.picks.items()
        if p.series.unit and _DIMENSIONS.get(si_unit(p.series.unit)[0]) == r
    }
    doubts = []
    spans = {r: float(np.subtract(*np.nanpercentile(p.series.values, (99.8, 0.2)))) for r, p in found.picks.items()}
    if "position" not in units:
        units["position"] = length_unit(spans["position"])
        doubts.append(
            f"unit of the position: {units['position']} is a guess, by how far it moves: {spans['position']:.3g}"
        )
    way = spans["position"] * si_unit(units["position"])[1]
    if "force" not in units:
        units["force"], elasticity = force_unit(spans["force"], way)
        doubts.append(
            f"unit of the force: {units['force']} is a guess, by which a tip of 5 mm would feel some "
            f"{elasticity / 1e3:.3g} kPa"
        )
    if "velocity" in found.picks and "velocity" not in units:
        units["velocity"], doubt = _speed_unit(looked, found, units["position"])
        doubts.append(doubt)
    return units, doubts


def _speed_unit(looked: _Looked, found: Found, length: str) -> tuple[str, str]:
    """The unit in which a velocity is the slope of the position."""
    if looked.clock is None or not found.gain:
        return f"{length}/s", f"unit of the velocity: {length}/s is a guess, as that of the position"
    ratios = {unit: abs(found.gain) * si_unit(unit)[1] / si_unit(length)[1] for unit in ("m/s", "mm/s", "um/s", "cm/s")}
    unit = min(ratios, key=lambda u: abs(np.log(ratios[u])))
    fits = abs(ratios[unit] - 1.0) < _LIKE
    by = (
        "by which it is the slope of the position"
        if fits
        else f"though it is {ratios[unit]:.2f} times the position's slope"
    )
    return unit, f"unit of the velocity: {unit} is a guess, {by}"
