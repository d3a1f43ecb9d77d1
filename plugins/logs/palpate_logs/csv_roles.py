"""The columns of a CSV file that are time, force, position and velocity, with their units, and a pipeline for them."""

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

_MAX_ROWS = 400_000  # by which roles and units are judged, a choice: memory, and the time of a suggestion
_MAX_NAMES = 6  # columns that a message names, a choice: a line
_USUAL_RATE = 500.0  # [Hz], a choice: by it the standstill at the beginning is looked for if no rate is known


@dataclass(frozen=True)
class SheetReading:
    """A table with its numbers and the times of its rows."""

    sheet: Sheet
    values: Floats  # (n, columns) as recorded
    clock: TimeColumn | None  # of the same n rows; None without a time

    def series(self) -> list[NumberColumn]:
        """Return the columns that can be force or motion, with the roles that their units or names state.

        The time, the parts of a stamp and a count of the rows are left out.
        """
        time = self.clock.seconds if self.clock else np.arange(len(self.values), dtype=float)
        time_columns = {*stamp_parts(self.sheet.names).values()}
        if self.clock is not None and self.clock.column is not None:
            time_columns.add(self.clock.column)
        series: list[NumberColumn] = []
        for index, role in enumerate(column_roles(self.sheet, self.values)):
            if role != "time" and index not in time_columns and not _counts_rows(self.values[:, index]):
                series.append(self._number_column(index, role, time))
        return series

    def _number_column(self, index: int, role: str | None, time: Floats) -> NumberColumn:
        """Return a column at times (n,), with a role and the reason for that: its unit, else its name."""
        unit = self.sheet.unit(index)
        reason = ""
        if unit:
            reason = f"in {unit}"
        elif role:
            reason = "by its name"
        return NumberColumn(
            label=f"column {column_text(self.sheet.column(index))}",
            time=time,
            values=self.values[:, index],
            role=role,
            why=reason,
            unit=unit,
            key=("", str(index)),  # a table has no topics
            named=self.sheet.header,
        )


def _counts_rows(values: Floats) -> bool:
    """Return True if a column (n,) of three rows or more grows by 1 from row to row."""
    return len(values) > 2 and bool((np.diff(values) == 1).all())


def read_sheet(path: Path, choices: Mapping[str, str]) -> SheetReading:
    """Return a table with its numbers and its time, by the choices of a person; raises LogError.

    Rows without a time are left out.
    """
    # The form of the file and the record in it, as far as they are chosen.
    sheet = sheet_of(path, {key: choices[key] for key in (*KEYS, RECORD) if key in choices})
    chosen_units = {key.removeprefix(UNITS): unit for key, unit in choices.items() if key.startswith(UNITS)}
    if chosen_units:
        sheet = replace(sheet, own_units=chosen_units)
    values = together(sheet.blocks(), _MAX_ROWS)
    # A chosen unit goes before that which the header states for one count.
    sheet = replace(sheet, own_units={**counts_of_header(sheet, values), **sheet.own_units})
    # A column that is chosen for a role is not the time.
    role_columns = [sheet.index_of(role, choices[role].removeprefix(":")) for role in ROLES if role in choices]
    clock = clock_of(sheet, values, choices, role_columns)
    if clock is not None:
        is_timed = np.isfinite(clock.seconds)
        if not is_timed.all():
            return SheetReading(sheet, values[is_timed], replace(clock, seconds=clock.seconds[is_timed]))
    return SheetReading(sheet, values, clock)


def suggest_csv(path: Path, choices: Mapping[str, str]) -> Suggestion:
    """Return tables that read a file, as its rules state them.

    Raises LogError if nothing in it can be a force or a position.
    """
    draft = _draft(path, choices)
    for add_statement in SUGGESTION_RULES:
        add_statement(draft)
    # Without a time, the unit of time is a row.
    suggestion = assemble_suggestion(
        draft.roles,
        draft.device,
        channels={role: f"log.{role}" for role in draft.roles.picks},
        factors=draft.factors,
        extra=draft.words,
        seconds=1.0 if draft.clock is not None else 1.0 / (draft.rate or _USUAL_RATE),
    )
    rivals = {**suggestion.rivals, **draft.rivals}
    # A scale that a person states answers the question of its column, too: that names the column.
    confirmed_roles = [role for role in draft.unscaled if f"columns.{role}.scale" in choices]
    return replace(
        suggestion,
        alignment={**suggestion.alignment, **draft.alignment},
        guesses={f"columns.{role}.unit": text for role, text in draft.unit_guesses.items()},
        rivals={role: columns for role, columns in rivals.items() if role not in confirmed_roles},
        facts=tuple((fact.line, fact.name, fact.value) for fact in facts_worth_stating(draft.sheet.facts)),
        has_time=draft.clock is not None and "time" in draft.clock.setting,
        template=suggestion.template if draft.sweep_speed is None else SWEEP_ANALYSIS,
        sweep_speed=draft.sweep_speed,
    )


def _draft(path: Path, choices: Mapping[str, str]) -> TableDraft:
    """Return a file with the roles and units of its columns; raises LogError."""
    _demand_known_keys(path, choices)
    reading = read_sheet(path, choices)
    sheet, clock = reading.sheet, reading.clock
    if clock is not None:
        demand_progress(sheet, clock, reading.values)
    series = reading.series()
    chosen = {
        role: _chosen_column(sheet, reading.values, series, role=role, text=choices[role])
        for role in ROLES
        if role in choices
    }
    # The deflection of a beam cannot be the position, unless a person says so.
    bends = deflections(series)
    candidates = [column for column in series if column not in bends or column in chosen.values()]
    roles = find_roles(candidates, chosen)
    if roles is None:
        raise LogError(f"{path}: {_missing_roles(sheet, series, chosen)}")
    units, unit_guesses = units_of(roles, sheet, has_time=clock is not None, tip=tip_of(choices))
    return TableDraft(
        path=path,
        choices=choices,
        sheet=sheet,
        values=reading.values,
        clock=clock,
        series=series,
        roles=roles,
        bends=bends,
        units=units,
        unit_guesses=unit_guesses,
        device={"type": "csv-replay", "file": str(path)},
    )


def _demand_known_keys(path: Path, choices: Mapping[str, str]) -> None:
    """Raise LogError for a choice that a table does not have."""
    keys = [*ROLES, LATERAL, "time", "rate", RECORD, POSITION_OF, *KEYS]
    for key in choices:
        if key not in (*keys, TIP, "file", "type") and not key.startswith(("columns.", UNITS)):
            raise LogError(f"{path}: a table has no {key!r}{suggest(key, keys)} (there are: {', '.join(keys)})")


def _missing_roles(sheet: Sheet, series: Sequence[NumberColumn], chosen: Mapping[str, NumberColumn]) -> str:
    """Return the message on force and position, of which no column can be one: the options, and excluded columns."""
    roles = {*chosen, *(column.role for column in series if does_move(column))}
    missing = [role for role in ("force", "position") if not roles & {role, None}] or ["force", "position"]
    constant = [column.key[1] for column in series if column.role in missing and not does_move(column)]
    excluded = {
        "by name or unit an angle, a torque or another quantity": _other_quantities(sheet, series, chosen),
        "the same number in every row": constant,
    }
    excluded_text = "".join(f"; {why}: {_names(sheet, columns)}" for why, columns in excluded.items() if columns)
    problem = "no two columns can be force and position"
    if len(missing) == 1:
        problem = f"no column can be the {missing[0]}"
    options = ", ".join(f"--{role}" for role in missing)
    return f"{problem}; choose with {options} (there are: {sheet.columns}){excluded_text}"


def _other_quantities(sheet: Sheet, series: Sequence[NumberColumn], chosen: Mapping[str, NumberColumn]) -> list[str]:
    """Return the columns, by number, whose name or unit states another quantity than force, height and velocity."""
    chosen_keys = {column.key for column in chosen.values()}
    others = [column.key[1] for column in series if column.role == "other" and column.key not in chosen_keys]
    return [k for k in others if sheet.unit(int(k)) is not None or role_by_words(sheet.names[int(k)]) == "other"]


def _names(sheet: Sheet, columns: Sequence[str]) -> str:
    """Return the names of columns, not more than a line can hold."""
    names = ", ".join(column_text(sheet.names[int(k)]) for k in columns[:_MAX_NAMES])
    return names + (", ..." if len(columns) > _MAX_NAMES else "")


def _chosen_column(
    sheet: Sheet, values: Floats, series: Sequence[NumberColumn], *, role: str, text: str
) -> NumberColumn:
    """Return the column that a person states for a role by a text, its name or number.

    `values` (n, columns) are the numbers of the sheet. Raises LogError for too few or constant numbers, and for a time.
    """
    index = sheet.index_of(role, text.removeprefix(":"))
    column_values = values[:, index]
    sheet.demand_numbers(role, index, column_values)
    if role != "velocity" and np.ptp(column_values[np.isfinite(column_values)]) == 0.0:
        raise LogError(f"{sheet.path}: --{role}: column {column_text(text)} has the same number in every row")
    for column in series:
        if column.key[1] == str(index):
            return replace(column, role=role, why="chosen")
    raise LogError(f"{sheet.path}: --{role}: column {column_text(text)} is the time, or counts the rows")
