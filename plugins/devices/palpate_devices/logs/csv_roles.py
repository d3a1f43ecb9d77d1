"""What a CSV file holds: which columns are time, force, position and velocity, in which units; a ready pipeline."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Batch, LogError, Suggestion, Survey, TopicSurvey, to_si

from palpate_devices.logs import roles
from palpate_devices.logs.csv_sheet import Floats, Sheet, together
from palpate_devices.logs.readings import SECOND, nanoseconds, si_unit
from palpate_devices.logs.roles import Candidate

_ROWS = 400_000  # that are looked into
_TARE = 0.9  # [s]
_PAUSE = 10.0  # usual intervals that make a gap
_RATES = (20.0, 5000.0)  # [Hz] of a recording, by which the unit of a time without one is told
_LARGEST = 0.2  # [m] that a palpation moves; a column that moves more is in millimetres
_DIMENSIONS = {"N": "force", "m": "position", "m/s": "velocity"}
_WORDS = {
    "force": re.compile(r"^(force|f|fz|f_z|force_?z|fn|load)$", re.IGNORECASE),
    "position": re.compile(r"^(position|pos|z|pos_?z|height|depth|displacement)$", re.IGNORECASE),
    "velocity": re.compile(r"^(velocity|vel|v|vz|v_z|vel_?z|speed)$", re.IGNORECASE),
    "time": re.compile(r"^(time|t|stamp|timestamp|seconds?|secs?)$", re.IGNORECASE),
}


@dataclass(frozen=True)
class Clock:
    """Where the time of a row comes from."""

    seconds: Floats  # (n,)
    setting: Mapping[str, Any] = field(default_factory=dict)  # of the device
    reason: str = ""
    column: int | None = None


@dataclass(frozen=True)
class _Looked:
    """A file, looked into."""

    sheet: Sheet
    values: Floats
    clock: Clock | None

    def candidates(self) -> list[Candidate]:
        """What each column may be: by its unit, by its name, and where neither speaks by how it moves."""
        names = self.sheet.names
        found: list[Candidate] = []
        taken = {self.clock.column} if self.clock else set()
        for k, name in enumerate(names):
            unit = self.sheet.unit(k)
            role = (
                _DIMENSIONS.get(si_unit(unit)[0]) if unit else next((r for r in _WORDS if _WORDS[r].match(name)), None)
            )
            if k not in taken and role in roles.ROLES and np.isfinite(self.values[:, k]).any():
                found.append(Candidate(str(role), "", str(k), f"in {unit}" if unit else "by its name"))
        told = {candidate.role for candidate in found}
        if self.clock is None or told == set(roles.ROLES):
            return found
        rest = [k for k in range(len(names)) if k not in taken and str(k) not in {c.field for c in found}]
        moved = roles.untyped("", list(map(str, rest)), self.clock.seconds, self.values[:, rest])
        return found + [c for c in moved if c.role in roles.ROLES and c.role not in told]

    def name(self, candidate: Candidate) -> str:
        """A column in words."""
        return f"column {self.sheet.column(int(candidate.field))!r}"


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
        columns = [k for k, name in enumerate(sheet.names) if _WORDS["time"].match(re.split(r"[_\s\[(]", name)[0])]
        columns += [k for k in range(len(sheet.names)) if k not in columns and _ticks(values[:, k])]
    for k in columns:
        steps = np.diff(values[:, k])
        usual = float(np.median(steps)) if len(steps) else 0.0
        unit = sheet.unit(k) or next((u for u in ("s", "ms", "us", "ns") if usual > 0 and _plausible(usual, u)), None)
        if unit is None or si_unit(unit)[0] != "s":
            continue
        seconds = values[:, k] * si_unit(unit)[1]
        reason = f"taken as {unit}: {1.0 / (usual * si_unit(unit)[1]):.4g} Hz" if usual > 0 else f"in {unit}"
        return Clock(seconds, {"time": {"column": sheet.column(k), "unit": unit}}, reason, k)
    return None


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
    raise LogError(f"{sheet.path}: --{role}: there is no column {choice!r} (there are: {', '.join(sheet.names)})")


def survey_csv(path: Path) -> Survey:
    """What a CSV file holds: its rows, their rate, and what its columns may be."""
    looked = _look(path, {})
    sheet, clock = looked.sheet, looked.clock
    rows = sum(len(block) for block in sheet.blocks())
    may = {int(c.field): c.role for c in looked.candidates()} | ({clock.column: "time"} if clock else {})
    columns = []
    for k, name in enumerate(sheet.names):
        known = looked.values[np.isfinite(looked.values[:, k]), k]
        span = f" {known.min():.4g} to {known.max():.4g}" if len(known) else " no numbers"
        unit = f" [{unit}]" if (unit := sheet.unit(k)) else ""
        columns.append(f"{name}{unit}{span}{f' ({may[k]}?)' if k in may else ''}")
    kind = f"{len(sheet.names)} columns, {'a header' if sheet.header else 'no header'}, {sheet.delimiter!r} between"
    notes = () if clock else ("no column holds the time: give the rate, --rate '500 Hz', or the column, --time",)
    if clock is None:
        return Survey(path, "CSV", (TopicSurvey(path.name, kind, "csv", rows, 0, 0, fields=tuple(columns)),), notes)
    stamps = nanoseconds(clock.seconds[np.isfinite(clock.seconds)])
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
    )
    return Survey(path, "CSV", (topic,), notes)


def tables_csv(path: Path) -> Iterator[tuple[str, tuple[str, ...], Batch]]:
    """Every row that has a time, in blocks, as recorded; raises LogError where no column holds the time."""
    looked = _look(path, {})
    sheet, clock = looked.sheet, looked.clock
    if clock is None or clock.column is None:
        raise LogError(f"{path}: no column holds the time (there are: {', '.join(sheet.names)})")
    scale = si_unit(str(clock.setting["time"]["unit"]))[1]
    for block in sheet.blocks():
        rows = np.isfinite(block[:, clock.column])
        stamps = nanoseconds(block[rows, clock.column] * scale)
        yield path.name, sheet.names, Batch(path.name, stamps, stamps, block[rows])


def suggest_csv(path: Path, choices: Mapping[str, str]) -> Suggestion:
    """Tables that read a CSV file; raises LogError where a role has no column, or several."""
    looked = _look(path, choices)
    sheet, clock = looked.sheet, looked.clock
    if clock is None:
        raise LogError(
            f"{path}: no column holds the time (there are: {', '.join(sheet.names)}): "
            "give --rate '500 Hz', or --time COLUMN"
        )
    candidates = looked.candidates()
    found = {role: c for role in roles.ROLES if (c := _settled(role, candidates, looked, choices)) is not None}
    columns = {role: int(candidate.field) for role, candidate in found.items()}
    units = _units(looked, columns)
    signs = roles.signs(
        dict.fromkeys(columns, clock.seconds), {role: looked.values[:, k] for role, k in columns.items()}
    )
    device: dict[str, Any] = {"type": "csv-replay", "file": str(path), **clock.setting}
    if sheet.delimiter != ",":
        device["delimiter"] = sheet.delimiter
    device["columns"] = {role: {"column": sheet.column(k), "unit": units[role]} for role, k in columns.items()}
    alignment: dict[str, Any] = {r: {"channel": f"log.{r}", "sign": getattr(signs, r)} for r in columns}
    reasons = [f"{role}: {looked.name(c)} in {units[role]} ({c.reason})" for role, c in found.items()]
    if clock.reason:
        reasons.append(f"time: {clock.reason}")
    if "velocity" not in found:
        reasons.append("velocity: none is recorded; it is the derivative of the position")
    if not roles.at_rest(clock.seconds, looked.values[:, columns["force"]], _TARE):
        alignment["tare"] = "none"
        reasons.append(f"tare: the force moves in the first {_TARE} s, which therefore give none")
    return Suggestion(device, alignment, tuple(reasons))


def _settled(
    role: str, candidates: Sequence[Candidate], looked: _Looked, choices: Mapping[str, str]
) -> Candidate | None:
    sheet = looked.sheet
    if role in choices:
        return Candidate(role, "", str(_index(sheet, role, choices[role].removeprefix(":"))), "chosen")
    mine = [candidate for candidate in candidates if candidate.role == role]
    if len(mine) > 1:
        named = " and ".join(looked.name(candidate) for candidate in mine)
        raise LogError(f"{sheet.path}: several columns could be the {role}: {named}; choose with --{role} COLUMN")
    if mine or role == "velocity":
        return mine[0] if mine else None
    there = ", ".join(sheet.names)
    raise LogError(f"{sheet.path}: nothing says by itself that it is the {role}; choose with --{role} COLUMN ({there})")


def _units(looked: _Looked, columns: Mapping[str, int]) -> dict[str, str]:
    """As the header says; else by how far the position moves, which is a few millimetres in a palpation."""
    said = {role: looked.sheet.unit(k) for role, k in columns.items()}
    position: NDArray[np.float64] = looked.values[:, columns["position"]]
    span = float(np.nanmax(position) - np.nanmin(position))
    length = said["position"] or ("mm" if span > _LARGEST else "m")
    guessed = {"force": "N", "position": length, "velocity": f"{length}/s"}
    return {role: said[role] or guessed[role] for role in columns}
