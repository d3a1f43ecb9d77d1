"""What a CSV file contains: which columns are time, force, position and velocity, in which units; a ready pipeline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from palpate import Floats, LogError, suggest
from palpate_kit.logs.role_guess import ROLES, NumberColumn, does_move
from palpate_kit.logs.suggestion import POSITION_OF, TIP, UNITS, assemble_suggestion, find_roles, tip_of
from palpate_records.recording import SWEEP_ANALYSIS, Suggestion
from palpate_records.tables.csv_clock import TimeColumn, clock_of, demand_progress
from palpate_records.tables.csv_layout import facts_worth_stating
from palpate_records.tables.csv_names import role_by_words, stamp_parts
from palpate_records.tables.csv_sheet import KEYS, Sheet, column_text, together
from palpate_records.tables.table_records import RECORD, sheet_of

from palpate_logs.csv_beam import deflections
from palpate_logs.csv_lateral import LATERAL
from palpate_logs.csv_units import counts_of_header, units_of
from palpate_logs.role_rules import column_roles
from palpate_logs.suggestion_rules import SUGGESTION_RULES
from palpate_logs.table_draft import TableDraft

_MAX_ROWS = 400_000  # that are looked into
_MAX_NAMES = 6  # columns of another quantity that are named
_USUAL_RATE = 500.0  # [Hz] by which the rest at the beginning is looked for where no rate is known


@dataclass(frozen=True)
class SheetRoles:
    """A file, looked into."""

    sheet: Sheet
    values: Floats
    clock: TimeColumn | None

    def series(self) -> list[NumberColumn]:
        """Return every column but the time, with its role by its unit or name."""
        time = self.clock.seconds if self.clock else np.arange(len(self.values), dtype=float)
        roles, stamps = column_roles(self.sheet, self.values), stamp_parts(self.sheet.names).values()
        found: list[NumberColumn] = []
        for k, role in enumerate(roles):
            if (
                role == "time"
                or k in stamps
                or (self.clock is not None and k == self.clock.column)
                or _counts(self.values[:, k])
            ):
                continue
            unit = self.sheet.unit(k)
            why = f"in {unit}" if unit else "by its name" if role else ""
            label = f"column {column_text(self.sheet.column(k))}"
            key = ("", str(k))
            found.append(NumberColumn(label, time, self.values[:, k], role, why, unit, key, self.sheet.header))
        return found


def _counts(values: Floats) -> bool:
    """Return True if a column merely counts the rows."""
    return len(values) > 2 and bool((np.diff(values) == 1).all())


def look(path: Path, choices: Mapping[str, str]) -> SheetRoles:
    """Return a file with its numbers and its time; raises LogError."""
    sheet = sheet_of(path, {key: choices[key] for key in (*KEYS, RECORD) if key in choices})
    units = {key.removeprefix(UNITS): text for key, text in choices.items() if key.startswith(UNITS)}
    sheet = replace(sheet, own_units=units) if units else sheet
    values = together(sheet.blocks(), _MAX_ROWS)
    sheet = replace(sheet, own_units={**counts_of_header(sheet, values), **sheet.own_units})
    taken = [sheet.index_of(role, choices[role].removeprefix(":")) for role in ROLES if role in choices]
    clock = clock_of(sheet, values, choices, taken)
    if clock is not None and not (timed := np.isfinite(clock.seconds)).all():
        return SheetRoles(sheet, values[timed], replace(clock, seconds=clock.seconds[timed]))
    return SheetRoles(sheet, values, clock)


def suggest_csv(path: Path, choices: Mapping[str, str]) -> Suggestion:
    """Return tables that read a file, as its rules state them.

    Raises LogError where nothing in it can be a force or a position.
    """
    draft = _draft(path, choices)
    for state in SUGGESTION_RULES:
        state(draft)
    names = {role: f"log.{role}" for role in draft.roles.picks}
    seconds = 1.0 if draft.clock is not None else 1.0 / (draft.rate or _USUAL_RATE)
    suggestion = assemble_suggestion(draft.roles, draft.device, names, draft.factors, draft.words, seconds)
    rivals = {**suggestion.rivals, **draft.rivals}
    confirmed = [role for role in draft.unscaled if f"columns.{role}.scale" in choices]  # the question names the column
    return replace(
        suggestion,
        alignment={**suggestion.alignment, **draft.alignment},
        guesses={f"columns.{role}.unit": text for role, text in draft.unit_guesses.items()},
        rivals={role: columns for role, columns in rivals.items() if role not in confirmed},
        facts=tuple((fact.line, fact.name, fact.value) for fact in facts_worth_stating(draft.sheet.facts)),
        has_time=draft.clock is not None and "time" in draft.clock.setting,
        template=suggestion.template if draft.sweep_speed is None else SWEEP_ANALYSIS,
        sweep_speed=draft.sweep_speed,
    )


def _draft(path: Path, choices: Mapping[str, str]) -> TableDraft:
    """Return a file with the roles and units of its columns; raises LogError."""
    known = [*ROLES, LATERAL, "time", "rate", RECORD, POSITION_OF, *KEYS]
    for key in choices:
        if key not in (*known, TIP, "file", "type") and not key.startswith(("columns.", UNITS)):
            raise LogError(f"{path}: a table has no {key!r}{suggest(key, known)} (there are: {', '.join(known)})")
    looked = look(path, choices)
    sheet, clock = looked.sheet, looked.clock
    if clock is not None:
        demand_progress(sheet, clock, looked.values)
    series = looked.series()
    chosen = {role: _chosen(sheet, looked.values, series, role, choices[role]) for role in ROLES if role in choices}
    bends = deflections(series)
    roles = find_roles([one for one in series if one not in bends or one in chosen.values()], chosen)
    if roles is None:
        raise LogError(f"{path}: {_missing_roles(sheet, series, chosen)}")
    units, guesses = units_of(roles, sheet, clock is not None, tip_of(choices))
    device = {"type": "csv-replay", "file": str(path)}
    return TableDraft(path, choices, sheet, looked.values, clock, series, roles, bends, units, guesses, device)


def _missing_roles(sheet: Sheet, series: Sequence[NumberColumn], chosen: Mapping[str, NumberColumn]) -> str:
    """Return which of force and position no column can be, and which columns are another quantity or constant."""
    roles = {*chosen, *(one.role for one in series if does_move(one))}
    missing = [role for role in ("force", "position") if not roles & {role, None}] or ["force", "position"]
    excluded = {
        "by name or unit an angle, a torque or another quantity": _other_quantities(sheet, series, chosen),
        "the same number in every row": [one.key[1] for one in series if one.role in missing and not does_move(one)],
    }
    about = "".join(f"; {why}: {_names(sheet, columns)}" for why, columns in excluded.items() if columns)
    options = ", ".join(f"--{role}" for role in missing)
    words = f"no column can be the {missing[0]}" if len(missing) == 1 else "no two columns can be force and position"
    return f"{words}; choose with {options} (there are: {sheet.columns}){about}"


def _other_quantities(sheet: Sheet, series: Sequence[NumberColumn], chosen: Mapping[str, NumberColumn]) -> list[str]:
    """Return the columns, by number, whose name or unit states another quantity than force, height and velocity."""
    taken = {one.key for one in chosen.values()}
    others = [one.key[1] for one in series if one.role == "other" and one.key not in taken]
    return [k for k in others if sheet.unit(int(k)) is not None or role_by_words(sheet.names[int(k)]) == "other"]


def _names(sheet: Sheet, columns: Sequence[str]) -> str:
    """Return the names of columns, not more than a line can hold."""
    shown = ", ".join(column_text(sheet.names[int(k)]) for k in columns[:_MAX_NAMES])
    return shown + (", ..." if len(columns) > _MAX_NAMES else "")


def _chosen(sheet: Sheet, values: Floats, series: Sequence[NumberColumn], role: str, text: str) -> NumberColumn:
    """Return the column that a person states for a role; raises LogError where it holds no course of numbers."""
    k = sheet.index_of(role, text.removeprefix(":"))
    sheet.demand_numbers(role, k, values[:, k])
    if role != "velocity" and np.ptp(values[np.isfinite(values[:, k]), k]) == 0.0:
        raise LogError(f"{sheet.path}: --{role}: column {column_text(text)} has the same number in every row")
    for mine in series:
        if mine.key[1] == str(k):
            return replace(mine, role=role, why="chosen")
    raise LogError(f"{sheet.path}: --{role}: column {column_text(text)} is the time, or counts the rows")
