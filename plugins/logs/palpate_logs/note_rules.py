"""Rules for what a person must know of a file: what is left out, and other columns that could have been read."""

from __future__ import annotations

import re

import numpy as np
from palpate import Floats
from palpate_kit.logs.role_evidence import noise as noise_of, roughness
from palpate_kit.logs.role_guess import NumberColumn, does_move
from palpate_records.tables.csv_layout import facts_worth_stating
from palpate_records.tables.csv_names import is_of_retraction
from palpate_records.tables.csv_sheet import KEYS, column_text
from palpate_records.tables.footer import event_words, footer_words
from palpate_records.tables.rules import Sureness, rule
from palpate_records.tables.table_records import RECORD, records_note

from palpate_logs.csv_units import counts_of_header
from palpate_logs.table_draft import TableDraft

_AXES = {*"xyzXYZ012"}


@rule("other columns that are a force", "which of several forces is read", Sureness.GUESS)
def other_forces(draft: TableDraft) -> None:
    """State the smoothest other force, with its noise relative to that of the one which is read."""
    force = draft.roles.picks["force"].series
    forces = [column for column in draft.series if column.role == "force" and column.key != force.key]
    rivals = [column for column in forces if does_move(column) and not _is_other_axis(column.label, force.label)]
    is_settled = force.role != "force" or "force" in {*draft.choices, *draft.rivals}
    if is_settled or not rivals:
        return
    rival = min(rivals, key=lambda column: roughness(_finite_values(column)))
    rival_noise, noise = noise_of(_finite_values(rival)), noise_of(_finite_values(force))
    comparison = ""
    if noise > 0.0 and rival_noise > 0.0:
        comparison = f", whose noise is {rival_noise / noise:.2g} times as large"
    draft.doubts.append(f"force: {force.label} is taken, not {rival.label}{comparison}; --force sets it")


def _finite_values(column: NumberColumn) -> Floats:
    """Return the finite values of a column."""
    return column.values[np.isfinite(column.values)]


def _is_other_axis(name: str, other: str) -> bool:
    """Return True for names that differ in the letter or number of an axis alone, as "fx_N" and "fz_N"."""
    differences = [{letter, other_letter} for letter, other_letter in zip(name, other) if letter != other_letter]
    return len(name) == len(other) and len(differences) == 1 and differences[0] <= _AXES


@rule("names that differ by a number only", "which of several presses is read", Sureness.GUESS)
def other_trials(draft: TableDraft) -> None:
    """State the columns whose names differ from that of a role by a number alone: several presses in one table."""
    for role, pick in draft.roles.picks.items():
        names = [draft.sheet.names[int(column.key[1])] for column in (pick.series, *pick.others)]
        stem = _without_numbers(names[0])
        alike_names = sorted(name for name in names if _without_numbers(name) == stem)
        if draft.sheet.header and len(alike_names) > 1 and "chosen" not in pick.why:
            draft.rivals[role] = tuple(alike_names)
            draft.doubts.append(f"{role}: {alike_names[0]} and {', '.join(alike_names[1:])} can be it")


def _without_numbers(name: str) -> str:
    """Return a name without its digits, as "force" of "force2"."""
    return re.sub(r"\d+", "", name)


@rule("words such as retract", "that the way back is left out", Sureness.WORD)
def retraction(draft: TableDraft) -> None:
    """State the columns of the retraction, which are left out."""
    names = [column_text(name) for name in draft.sheet.names if is_of_retraction(name)]
    if names:
        draft.reasons.append(f"left out: {', '.join(names)}: the way back, next to the way in")


@rule("lines of words between and below the rows", "events, and where the table ends", Sureness.STATED)
def lines_of_words(draft: TableDraft) -> None:
    """State the lines of words that are passed over."""
    sheet = draft.sheet
    if sheet.events:
        draft.doubts.append(event_words(sheet.events))
    if sheet.footer:
        draft.doubts.append(footer_words(sheet.footer))


@rule("other records of the file", "that one of several is read", Sureness.STATED)
def other_records(draft: TableDraft) -> None:
    """State the names of the records if none is chosen."""
    stated = {key: draft.choices[key] for key in (*KEYS, RECORD) if key in draft.choices}
    note = records_note(draft.path, stated)
    if note is not None:
        draft.doubts.append(note)


@rule("a line such as Counts per Force", "how much force one count is", Sureness.STATED)
def scale_of_counts(draft: TableDraft) -> None:
    """State the force of one count, if the file states it and the force is read by it."""
    column = draft.index("force")
    count_size = counts_of_header(draft.sheet, draft.values).get(draft.sheet.names[column])
    if count_size is not None and draft.sheet.scale(column) != 1.0:
        draft.reasons.append(
            f"scale of the force: one count is {count_size}, by the counts per force that the file states"
        )


@rule("lines above the names", "values of the experiment, which a person may state", Sureness.STATED)
def stated_values(draft: TableDraft) -> None:
    """State the values of the experiment above the names of the columns."""
    facts = facts_worth_stating(draft.sheet.facts)
    draft.hints += [f"line {fact.line} states: {fact.name}: {fact.value}" for fact in facts]


NOTE_RULES = (
    other_trials,
    other_forces,
    retraction,
    lines_of_words,
    other_records,
    scale_of_counts,
    stated_values,
)
