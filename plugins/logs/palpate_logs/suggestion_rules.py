"""Rules for the tables that read a file: each states one thing of them, and what a person must know of it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats, LogError
from palpate_kit.logs.role_guess import NumberColumn, RoleGuess
from palpate_kit.logs.suggestion import POSITION_OF
from palpate_records.messages.readings import si_unit
from palpate_records.tables.csv_clock import RATES, TimeColumn
from palpate_records.tables.csv_layout import facts_worth_stating
from palpate_records.tables.csv_names import is_depth, is_of_retraction
from palpate_records.tables.csv_sheet import KEYS, Sheet, column_text
from palpate_records.tables.footer import event_words, footer_words
from palpate_records.tables.rules import Sureness, rule
from palpate_records.tables.table_records import RECORD, records_note

from palpate_logs.csv_beam import stiffness_of, which_of_both
from palpate_logs.csv_pose import places_of, with_axes
from palpate_logs.csv_units import needs_scale

# Rates [Hz] that loggers have, and by how much one that follows from the numbers may miss them.
_LOGGER_RATES = (
    *(20, 25, 50, 60, 80, 100, 120, 125, 200, 250, 300, 400, 500, 600, 800),
    *(1000, 1200, 1500, 2000, 2500, 4000, 5000),
)
_RATE_TOLERANCE = 0.05


@dataclass
class TableDraft:
    """A file, the roles of its columns, and the tables and words that the rules make of them."""

    path: Path
    choices: Mapping[str, str]
    sheet: Sheet
    values: Floats  # (n, columns)
    clock: TimeColumn | None
    roles: RoleGuess
    bends: Sequence[NumberColumn]  # lengths by which a beam yields
    units: Mapping[str, str]  # by role
    unit_guesses: Mapping[str, str]  # what is said of those that are guesses
    device: dict[str, Any] = field(default_factory=dict)
    alignment: dict[str, Any] = field(default_factory=dict)
    rivals: dict[str, tuple[str, ...]] = field(default_factory=dict)
    rate: float | None = None  # [Hz] where no column is the time
    reasons: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    blanks: list[str] = field(default_factory=list)
    hints: list[str] = field(default_factory=list)

    def index(self, role: str) -> int:
        """The column of a role."""
        return int(self.roles.picks[role].series.key[1])

    @cached_property
    def unscaled(self) -> set[str]:
        """Roles of which only a person knows how much one number is."""
        return {role for role, pick in self.roles.picks.items() if needs_scale(self.sheet, pick, role)}

    @cached_property
    def factors(self) -> dict[str, float]:
        """What one number of a role is in SI."""
        return {role: si_unit(unit)[1] * self.sheet.scale(self.index(role)) for role, unit in self.units.items()}

    @property
    def words(self) -> dict[str, Sequence[str]]:
        """Reasons, doubts, blanks and hints."""
        return {"reasons": self.reasons, "doubts": self.doubts, "blanks": self.blanks, "hints": self.hints}


@rule("ranges of columns without a unit", "the likeliest units", Sureness.GUESS)
def units_by_range(draft: TableDraft) -> None:
    """State which units are guesses."""
    draft.doubts += draft.unit_guesses.values()


@rule("the column of the time", "the time of a row", Sureness.STATED)
def time_of_rows(draft: TableDraft) -> None:
    """State which column is the time, and that it is a guess where nothing but its numbers says so."""
    clock = draft.clock
    if clock is None:
        return
    draft.device |= clock.setting
    draft.reasons += [f"time: {clock.reason}"] if clock.reason else []
    if not clock.sure:
        column = f"column {column_text(draft.sheet.column(clock.column or 0))}"
        draft.doubts.append(f"time: {column} is a guess: it grows evenly ({clock.reason}); --time sets it")


@rule("velocity and height of a file without a time", "the rate of its rows", Sureness.GUESS)
def rate_of_rows(draft: TableDraft) -> None:
    """State the rate at which the velocity is the slope of the height; ask for it without a velocity."""
    if draft.clock is not None:
        return
    draft.rate = _rate_by_velocity(draft)
    if draft.rate is None:
        draft.blanks.append("rate: rows per second; nothing in the file states it (or --rate '500 Hz')")
        draft.device["rate"] = "? Hz"
        return
    draft.device["rate"] = f"{draft.rate:g} Hz"
    draft.doubts.append(
        f"rate: {draft.rate:g} Hz is a guess: nothing states it, but at this rate the velocity is the slope of the "
        "position; --rate sets it"
    )


def _rate_by_velocity(draft: TableDraft) -> float | None:
    """Return the rate [Hz] at which the velocity is the slope of the height; None for none that a logger has."""
    if not draft.roles.gain:
        return None
    rate = abs(draft.roles.gain) * draft.factors["velocity"] / draft.factors["position"]
    nearest = min(_LOGGER_RATES, key=lambda one: abs(np.log(one / rate)))
    rate = nearest if abs(nearest / rate - 1.0) < _RATE_TOLERANCE else float(f"{rate:.3g}")
    return rate if RATES[0] <= rate <= RATES[1] else None


@rule("how the file is written", "separator, decimals, lines of names and units", Sureness.STATED)
def writing(draft: TableDraft) -> None:
    """State how the file is written where that is not the usual way."""
    draft.device |= draft.sheet.settings


@rule("the columns of the roles", "columns, units and scales of the channels", Sureness.STATED)
def channels(draft: TableDraft) -> None:
    """State the columns; what one of a unit is that only a person knows, is a blank."""
    columns: dict[str, dict[str, Any]] = {}
    for role, pick in draft.roles.picks.items():
        k = draft.index(role)
        columns[role] = {"column": draft.sheet.column(k), "unit": draft.units[role]}
        if (scale := draft.sheet.scale(k)) != 1.0:
            columns[role]["scale"] = scale
        if role not in draft.unscaled:
            continue
        key = f"columns.{role}.scale"
        columns[role]["scale"] = _chosen_scale(draft, key)
        if key not in draft.choices:
            unit = draft.sheet.written_unit(k) or "unit"
            draft.blanks.append(f"{key}: how many {draft.units[role]} one {unit} of {pick.series.label} is")
    draft.device["columns"] = with_axes(columns, draft.roles, draft.sheet, draft.values)


def _chosen_scale(draft: TableDraft, key: str) -> float | str:
    """Return the scale that a person states, "?" without one; raises LogError where it is not a number."""
    if key not in draft.choices:
        return "?"
    try:
        return float(draft.choices[key])
    except ValueError as error:
        raise LogError(f"{draft.path}: {key} = {draft.choices[key]!r}: expected a number") from error


@rule("names that differ by a number only", "which of several presses is read", Sureness.GUESS)
def other_trials(draft: TableDraft) -> None:
    """State columns that serve as well as those of a role: several presses in one table."""
    for role, pick in draft.roles.picks.items():
        indices = [int(series.key[1]) for series in (pick.series, *pick.others)]
        stems = [re.sub(r"\d+", "", draft.sheet.names[k]) for k in indices]
        alike = sorted(draft.sheet.names[k] for k, stem in zip(indices, stems, strict=True) if stem == stems[0])
        if draft.sheet.header and len(alike) > 1 and "chosen" not in pick.why:
            draft.rivals[role] = tuple(alike)
            draft.doubts.append(f"{role}: {alike[0]} and {', '.join(alike[1:])} can be it")


@rule("words such as retract", "that the way back is left out", Sureness.WORD)
def retraction(draft: TableDraft) -> None:
    """State the columns of the way back."""
    back = [name for name in draft.sheet.names if is_of_retraction(name)]
    if back:
        draft.reasons.append(f"left out: {', '.join(map(column_text, back))}: the way back, next to the way in")


@rule("lines of words between and below the rows", "events, and where the table ends", Sureness.STATED)
def lines_of_words(draft: TableDraft) -> None:
    """State what is passed over."""
    sheet = draft.sheet
    draft.doubts += [event_words(sheet.events)] if sheet.events else []
    draft.doubts += [footer_words(sheet.footer)] if sheet.footer else []


@rule("other records of the file", "that one of several is read", Sureness.STATED)
def other_records(draft: TableDraft) -> None:
    """State the names of the records where none is chosen."""
    stated = {key: draft.choices[key] for key in (*KEYS, RECORD) if key in draft.choices}
    note = records_note(draft.path, stated)
    draft.doubts += [note] if note is not None else []


@rule("lines above the names", "values of the experiment, which a person may state", Sureness.STATED)
def stated_values(draft: TableDraft) -> None:
    """State what the file says of the experiment."""
    facts = facts_worth_stating(draft.sheet.facts)
    draft.hints += [f"line {fact.line} states: {fact.name}: {fact.value}" for fact in facts]


@rule("columns x and y of a record", "its place along the skin", Sureness.STATED)
def place_of_record(draft: TableDraft) -> None:
    """State where along the skin a record is."""
    places = places_of(draft.sheet) if draft.sheet.record is not None else {}
    draft.device["columns"] |= places
    draft.alignment |= {f"lateral_{name}": f"log.{name}" for name in places}


@rule(
    "a length over which the force is one constant", "a beam behind the tip, and the stage behind that", Sureness.GUESS
)
def beam(draft: TableDraft) -> None:
    """State the stiffness of a beam where the height is that of its stage; ask for that."""
    is_settled = "position" in draft.choices or is_depth(draft.sheet.names[draft.index("position")])
    position_of = draft.choices.get(POSITION_OF)
    if not draft.bends or is_settled or position_of == "tip":
        return
    bend = draft.bends[0]
    if position_of != "stage":
        draft.blanks.append(f"{POSITION_OF}: {which_of_both(bend, draft.roles.picks['position'].series)}")
        return
    length = draft.sheet.unit(int(bend.key[1])) or draft.units["position"]
    stiffness = stiffness_of(bend.values, draft.roles.picks["force"].series.values)
    draft.alignment["beam"] = f"{stiffness * draft.factors['force'] / si_unit(length)[1]:.6g} N/m"
    draft.reasons.append(f"beam: {draft.alignment['beam']}: the force over {bend.label}, which is taken off")


SUGGESTION_RULES = (
    units_by_range,
    time_of_rows,
    rate_of_rows,
    writing,
    channels,
    other_trials,
    retraction,
    lines_of_words,
    other_records,
    stated_values,
    beam,
    place_of_record,
)
