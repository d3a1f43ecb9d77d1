"""Rules for the tables that read a file: each states one key of them, or asks a person for it."""

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

from palpate_logs.csv_beam import spring_constant, stage_question
from palpate_logs.csv_lateral import LATERAL, lateral_columns
from palpate_logs.csv_pose import place_columns, with_axes
from palpate_logs.note_rules import NOTE_RULES
from palpate_logs.table_draft import TableDraft

_LOGGER_RATES = (  # [Hz]
    *(20, 25, 50, 60, 80, 100, 120, 125, 200, 250, 300, 400, 500, 600, 800),
    *(1000, 1200, 1500, 2000, 2500, 4000, 5000),
)
_RATE_TOLERANCE = 0.05  # relative, of a rate by the slope of noisy numbers to that of a logger: a choice


@rule("ranges of columns without a unit", "the likeliest units", Sureness.GUESS)
def units_by_range(draft: TableDraft) -> None:
    """State the units that are guesses."""
    draft.doubts += draft.unit_guesses.values()


@rule("the column of the time", "the time of a row", Sureness.STATED)
def time_of_rows(draft: TableDraft) -> None:
    """State the column of the time, and that it is a guess if nothing but its numbers says so."""
    clock = draft.clock
    if clock is None:
        return
    draft.device |= clock.setting
    if clock.reason:
        draft.reasons.append(f"time: {clock.reason}")
    if clock.note:
        draft.doubts.append(clock.note)
    if not clock.sure:
        column = f"column {column_text(draft.sheet.column(clock.column or 0))}"
        draft.doubts.append(f"time: {column} is a guess: it grows evenly ({clock.reason}); --time sets it")


@rule("velocity and height of a file without a time", "the rate of its rows", Sureness.GUESS)
def rate_of_rows(draft: TableDraft) -> None:
    """State the rate at which the velocity is the slope of the height; without a velocity, ask for the rate."""
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
    """Return the rate [Hz] at which the velocity is the slope of the height, that of a logger if one is near.

    The gain of the roles is the velocity over the change of the height from row to row. None without a velocity, and
    for a rate that no recording has.
    """
    if not draft.roles.gain:
        return None
    exact_rate = abs(draft.roles.gain) * draft.factors["velocity"] / draft.factors["position"]
    logger_rate = min(_LOGGER_RATES, key=lambda candidate: abs(np.log(candidate / exact_rate)))
    is_near = abs(logger_rate / exact_rate - 1.0) < _RATE_TOLERANCE
    rate = logger_rate if is_near else float(f"{exact_rate:.3g}")
    min_rate, max_rate = RATES
    return rate if min_rate <= rate <= max_rate else None


@rule("how the file is written", "separator, decimals, lines of names and units", Sureness.STATED)
def writing(draft: TableDraft) -> None:
    """State the keys on the form of the file that are not the usual ones."""
    draft.device |= draft.sheet.settings


@rule("the columns of the roles", "columns, units and scales of the channels", Sureness.STATED)
def channels(draft: TableDraft) -> None:
    """State the columns; the scale of one in a unit that only a person knows is a blank."""
    columns: dict[str, dict[str, Any]] = {}
    for role, pick in draft.roles.picks.items():
        index = draft.index(role)
        columns[role] = {"column": draft.sheet.column(index), "unit": draft.units[role]}
        sheet_scale = draft.sheet.scale(index)
        if sheet_scale != 1.0:
            columns[role]["scale"] = sheet_scale
        if role not in draft.unscaled:
            continue
        key = f"columns.{role}.scale"
        columns[role]["scale"] = _chosen_scale(draft, key)
        if key not in draft.choices:
            written_unit = draft.sheet.written_unit(index) or "unit"
            draft.blanks.append(f"{key}: how many {draft.units[role]} one {written_unit} of {pick.series.label} is")
    draft.device["columns"] = with_axes(columns, draft.roles, draft.sheet, draft.values)


def _chosen_scale(draft: TableDraft, key: str) -> float | str:
    """Return the scale that a person states for a key, "?" without one; raises LogError for another text."""
    if key not in draft.choices:
        return "?"
    try:
        return float(draft.choices[key])
    except ValueError as error:
        raise LogError(f"{draft.path}: {key} = {draft.choices[key]!r}: expected a number") from error


@rule("columns x and y of a record", "its place along the skin", Sureness.STATED)
def place_of_record(draft: TableDraft) -> None:
    """State where along the skin a record is."""
    places = place_columns(draft.sheet) if draft.sheet.record is not None else {}
    draft.device["columns"] |= places
    draft.alignment |= {f"lateral_{name}": f"log.{name}" for name in places}


@rule("columns x and y, or elements of a pose, that move", "the place of a sweep along the skin", Sureness.WORD)
def place_of_sweep(draft: TableDraft) -> None:
    """State the columns of the place of the tip along the skin; hint at one that only moves like a place."""
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
    """State the stiffness of a beam if the height is that of its stage; ask whether it is."""
    is_settled = "position" in draft.choices or is_depth(draft.sheet.names[draft.index("position")])
    position_of = draft.choices.get(POSITION_OF)
    if not draft.bends or is_settled or position_of == "tip":
        return
    deflection = draft.bends[0]
    if position_of != "stage":
        draft.blanks.append(f"{POSITION_OF}: {stage_question(deflection, draft.roles.picks['position'].series)}")
        return
    deflection_unit = draft.sheet.unit(int(deflection.key[1])) or draft.units["position"]
    stiffness = spring_constant(deflection.values, draft.roles.picks["force"].series.values)  # as recorded
    draft.alignment["beam"] = f"{stiffness * draft.factors['force'] / si_unit(deflection_unit)[1]:.6g} N/m"
    draft.reasons.append(f"beam: {draft.alignment['beam']}: the force over {deflection.label}, which is taken off")


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
