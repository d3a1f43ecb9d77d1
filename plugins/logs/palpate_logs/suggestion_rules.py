"""Rules for the tables that read a file: each states one thing of them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from palpate import LogError
from palpate_kit.logs.suggestion import POSITION_OF
from palpate_records.messages.readings import si_unit
from palpate_records.tables.csv_clock import RATES
from palpate_records.tables.csv_names import is_depth
from palpate_records.tables.csv_sheet import column_text
from palpate_records.tables.rules import Sureness, rule

from palpate_logs.csv_beam import stiffness_of, which_of_both
from palpate_logs.csv_lateral import LATERAL, lateral_columns
from palpate_logs.csv_pose import places_of, with_axes
from palpate_logs.note_rules import NOTE_RULES
from palpate_logs.table_draft import TableDraft

# Rates [Hz] that loggers have, and by how much one that follows from the numbers may miss them.
_LOGGER_RATES = (
    *(20, 25, 50, 60, 80, 100, 120, 125, 200, 250, 300, 400, 500, 600, 800),
    *(1000, 1200, 1500, 2000, 2500, 4000, 5000),
)
_RATE_TOLERANCE = 0.05


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
    draft.doubts += [clock.note] if clock.note else []
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


@rule("columns x and y of a record", "its place along the skin", Sureness.STATED)
def place_of_record(draft: TableDraft) -> None:
    """State where along the skin a record is."""
    places = places_of(draft.sheet) if draft.sheet.record is not None else {}
    draft.device["columns"] |= places
    draft.alignment |= {f"lateral_{name}": f"log.{name}" for name in places}


@rule("columns x and y, or elements of a pose, that move", "the place of a sweep along the skin", Sureness.WORD)
def place_of_sweep(draft: TableDraft) -> None:
    """State the columns of the tip's place along the skin; ask for one that only moves like it."""
    if draft.sheet.record is not None:
        return
    picks = {role: draft.index(role) for role in draft.roles.picks}
    lateral = lateral_columns(draft.sheet, draft.values, picks, draft.units["position"], draft.choices.get(LATERAL))
    draft.device["columns"] |= lateral.columns
    draft.alignment |= {f"lateral_{axis}": f"log.{axis}" for axis in lateral.columns}
    if lateral.columns:
        draft.sweep_speed = math.nan if draft.seconds is None else lateral.speed(draft.seconds)
    draft.doubts += [*lateral.doubts, *lateral.hints]


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
    *NOTE_RULES,
    beam,
    place_of_record,
    place_of_sweep,
)
