"""Rules for what a person must know of a file: what is left out, and what else could have been read."""

from __future__ import annotations

import re

import numpy as np
from palpate_kit.logs.role_evidence import noise as noise_of, roughness
from palpate_kit.logs.role_guess import does_move
from palpate_records.tables.csv_layout import facts_worth_stating
from palpate_records.tables.csv_names import is_of_retraction
from palpate_records.tables.csv_sheet import KEYS, column_text
from palpate_records.tables.footer import event_words, footer_words
from palpate_records.tables.rules import Sureness, rule
from palpate_records.tables.table_records import RECORD, records_note

from palpate_logs.csv_units import counts_of_header
from palpate_logs.table_draft import TableDraft


@rule("other columns that are a force", "which of several forces is read", Sureness.GUESS)
def other_forces(draft: TableDraft) -> None:
    """State a force that is not taken, by its noise over that of the one that is."""
    force = draft.roles.picks["force"].series
    forces = [column for column in draft.series if column.role == "force" and column.key != force.key]
    rivals = [column for column in forces if does_move(column) and not _is_other_axis(column.label, force.label)]
    if force.role != "force" or not rivals or "force" in {*draft.choices, *draft.rivals}:
        return
    rival = min(rivals, key=lambda column: roughness(column.values[np.isfinite(column.values)]))
    rival_noise, noise = (noise_of(column.values[np.isfinite(column.values)]) for column in (rival, force))
    ratio = f", whose noise is {rival_noise / noise:.2g} times as large" if noise > 0.0 and rival_noise > 0.0 else ""
    draft.doubts.append(f"force: {force.label} is taken, not {rival.label}{ratio}; --force sets it")


_AXES = {*"xyzXYZ012"}


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


def _is_other_axis(name: str, other: str) -> bool:
    """Return True for names that differ in the letter or number of an axis alone, as "fx_N" and "fz_N"."""
    differences = [{a, b} for a, b in zip(name, other) if a != b]
    return len(name) == len(other) and len(differences) == 1 and differences[0] <= _AXES


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


@rule("a line such as Counts per Force", "how much force one count is", Sureness.STATED)
def scale_of_counts(draft: TableDraft) -> None:
    """State the scale that the file states."""
    column = draft.index("force")
    size = counts_of_header(draft.sheet, draft.values).get(draft.sheet.names[column])
    if size is not None and draft.sheet.scale(column) != 1.0:
        draft.reasons.append(f"scale of the force: one count is {size}, by the counts per force that the file states")


@rule("lines above the names", "values of the experiment, which a person may state", Sureness.STATED)
def stated_values(draft: TableDraft) -> None:
    """State what the file says of the experiment."""
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
