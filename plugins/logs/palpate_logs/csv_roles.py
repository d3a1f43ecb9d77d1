"""What a CSV file contains: which columns are time, force, position and velocity, in which units; a ready pipeline."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats, LogError, suggest
from palpate_kit.logs.role_guess import ROLES, NumberColumn, RoleGuess, does_move
from palpate_kit.logs.suggestion import POSITION_OF, TIP, UNITS, assemble_suggestion, find_roles, tip_of
from palpate_records.messages.readings import si_unit
from palpate_records.recording import Suggestion
from palpate_records.tables.csv_clock import RATES, TimeColumn, clock_of, demand_progress
from palpate_records.tables.csv_layout import facts_worth_stating
from palpate_records.tables.csv_names import (
    contradicts,
    exact_role,
    is_another_quantity,
    is_depth,
    is_of_retraction,
    role_by_words,
    stamp_parts,
    symbol_role,
)
from palpate_records.tables.csv_sheet import KEYS, Sheet, column_text, together
from palpate_records.tables.footer import event_words, footer_words
from palpate_records.tables.table_records import RECORD, records_note, sheet_of

from palpate_logs.csv_beam import deflections, stiffness_of, which_of_both
from palpate_logs.csv_pose import places_of, sideways_forces, turning_elements, with_axes
from palpate_logs.csv_units import DIMENSIONS, needs_scale, units_of

_ROWS = 400_000  # that are looked into
_OTHERS = 6  # columns of another quantity that are named
_NICE = (20, 25, 50, 60, 80, 100, 120, 125, 200, 250, 300, 400, 500, 600, 800, 1000, 1200, 1500, 2000, 2500, 4000, 5000)
_USUAL = 500.0  # [Hz] by which the rest at the beginning is looked for where no rate is known
_NEAR = 0.05  # by which a rate found from the numbers may miss one of those


@dataclass(frozen=True)
class SheetRoles:
    """A file, looked into."""

    sheet: Sheet
    values: Floats
    clock: TimeColumn | None

    def series(self) -> list[NumberColumn]:
        """Every column but the time, with its role by its unit or name."""
        time = self.clock.seconds if self.clock else np.arange(len(self.values), dtype=float)
        roles, stamps = self._roles(), stamp_parts(self.sheet.names).values()
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

    def _roles(self) -> list[str | None]:
        """What each column's unit states, else its name, else a word of it; "other" if nothing does."""
        names, roles = self.sheet.names, []
        for k, name in enumerate(names):
            unit = self.sheet.unit(k)
            by_unit = DIMENSIONS.get(si_unit(unit)[0], "other") if unit else None
            is_other = is_another_quantity(name) and by_unit != "force"
            is_other = is_other or (by_unit in ("force", "position") and contradicts(name, by_unit))
            roles.append("other" if is_other else by_unit or exact_role(name))
        for role_of in (role_by_words, symbol_role):
            for role in (*ROLES, "other"):
                if role == "other" or role not in roles:
                    roles = [mine or (role if role_of(name) == role else None) for mine, name in zip(roles, names)]
        places = [k for k, mine in enumerate(roles) if mine == "position"]
        # A column of zeros is of an instrument that works the depth out later, if at all.
        if depths := [
            k for k in places if is_depth(names[k]) and float(np.nanmax(np.abs(self.values[:, k]), initial=0))
        ]:
            roles = ["other" if k in places and k not in depths else mine for k, mine in enumerate(roles)]
        if not all(map(is_of_retraction, names)):
            roles = ["other" if is_of_retraction(name) else mine for mine, name in zip(roles, names)]
        beside = sideways_forces(names, roles, self.values) | turning_elements(names)
        return ["other" if k in beside else role for k, role in enumerate(roles)]


def _counts(values: Floats) -> bool:
    """Whether a column merely counts the rows."""
    return len(values) > 2 and bool((np.diff(values) == 1).all())


def look(path: Path, choices: Mapping[str, str]) -> SheetRoles:
    """A file with its numbers and its time; raises LogError."""
    sheet = sheet_of(path, {key: choices[key] for key in (*KEYS, RECORD) if key in choices})
    units = {key.removeprefix(UNITS): text for key, text in choices.items() if key.startswith(UNITS)}
    sheet = replace(sheet, own_units=units) if units else sheet
    values = together(sheet.blocks(), _ROWS)
    taken = [sheet.index_of(role, choices[role].removeprefix(":")) for role in ROLES if role in choices]
    clock = clock_of(sheet, values, choices, taken)
    if clock is not None and not (timed := np.isfinite(clock.seconds)).all():
        return SheetRoles(sheet, values[timed], replace(clock, seconds=clock.seconds[timed]))
    return SheetRoles(sheet, values, clock)


def suggest_csv(path: Path, choices: Mapping[str, str]) -> Suggestion:
    """Tables that read a CSV file; raises LogError where nothing in it can be a force or a position."""
    known = [*ROLES, "time", "rate", RECORD, POSITION_OF, *KEYS]
    for key in choices:
        if key not in (*known, TIP, "file", "type") and not key.startswith(("columns.", UNITS)):
            raise LogError(f"{path}: a table has no {key!r}{suggest(key, known)} (there are: {', '.join(known)})")
    looked = look(path, choices)
    sheet, clock = looked.sheet, looked.clock
    if clock is not None:
        demand_progress(sheet, clock, looked.values)
    series = looked.series()
    chosen = {role: _chosen(sheet, looked.values, series, role, choices[role]) for role in ROLES if role in choices}
    bent = deflections(series)
    found = find_roles([s for s in series if s not in bent or s in chosen.values()], chosen)
    if found is None:
        raise LogError(f"{path}: {_missing_roles(sheet, series, chosen)}")
    depth = is_depth(sheet.names[int(found.picks["position"].series.key[1])])
    bent = [] if "position" in chosen or depth or choices.get(POSITION_OF) == "tip" else bent
    units, guesses = units_of(found, sheet, clock is not None, tip_of(choices))
    unscaled = {role for role, pick in found.picks.items() if needs_scale(sheet, pick, role)}
    doubts = list(guesses.values())
    scales = {role: sheet.scale(int(pick.series.key[1])) for role, pick in found.picks.items()}
    factors = {role: si_unit(unit)[1] * scales[role] for role, unit in units.items()}
    device: dict[str, Any] = {"type": "csv-replay", "file": str(path)}
    extra: dict[str, list[str]] = {"reasons": [], "doubts": doubts, "blanks": [], "hints": []}
    rate = None
    has_time = clock is not None and clock.column is not None
    if clock is not None:
        device |= clock.setting
        extra["reasons"] += [f"time: {clock.reason}"] if clock.reason else []
        if not clock.sure:
            column = f"column {column_text(sheet.column(clock.column or 0))}"
            doubts.append(f"time: {column} is a guess: it grows evenly ({clock.reason}); --time sets it")
    else:
        rate = _rate(found, factors, extra)
        device["rate"] = "? Hz" if rate is None else f"{rate:g} Hz"
    device |= sheet.settings
    columns = _columns(found, sheet, units, unscaled, choices, extra["blanks"])
    device["columns"] = with_axes(columns, found, sheet, looked.values)
    trials = _other_trials(found, sheet)
    doubts += [f"{role}: {names[0]} and {', '.join(names[1:])} can be it" for role, names in trials.items()]
    back = [name for name in sheet.names if is_of_retraction(name)]
    if back:
        extra["reasons"].append(f"left out: {', '.join(map(column_text, back))}: the way back, next to the way in")
    doubts += [event_words(sheet.events)] if sheet.events else []
    doubts += [footer_words(sheet.footer)] if sheet.footer else []
    stated = {key: choices[key] for key in (*KEYS, RECORD) if key in choices}
    doubts += [note] if (note := records_note(path, stated)) is not None else []
    facts = facts_worth_stating(sheet.facts)
    extra["hints"] += [f"line {fact.line} states: {fact.name}: {fact.value}" for fact in facts]
    channels = {role: f"log.{role}" for role in found.picks}
    places = places_of(sheet) if sheet.record is not None else {}
    device["columns"] |= places
    beam: dict[str, str] = {}
    if bent and choices.get(POSITION_OF) == "stage":
        length = sheet.unit(int(bent[0].key[1])) or units["position"]
        each = stiffness_of(bent[0].values, found.picks["force"].series.values)
        beam["beam"] = f"{each * factors['force'] / si_unit(length)[1]:.6g} N/m"
        extra["reasons"].append(f"beam: {beam['beam']}: the force over {bent[0].label}, which is taken off")
    elif bent:
        extra["blanks"].append(f"{POSITION_OF}: {which_of_both(bent[0], found.picks['position'].series)}")
    second = 1.0 if clock is not None else 1.0 / (rate or _USUAL)
    suggestion = assemble_suggestion(found, device, channels, factors, extra, second)
    alignment = {**suggestion.alignment, **beam, **{f"lateral_{name}": f"log.{name}" for name in places}}
    keys = {f"columns.{role}.unit": text for role, text in guesses.items()}
    confirmed = [role for role in unscaled if f"columns.{role}.scale" in choices]  # the question names the column
    rivals = {role: names for role, names in {**suggestion.rivals, **trials}.items() if role not in confirmed}
    worth = tuple((fact.line, fact.name, fact.value) for fact in facts)
    return replace(suggestion, alignment=alignment, guesses=keys, rivals=rivals, facts=worth, has_time=has_time)


def _missing_roles(sheet: Sheet, series: Sequence[NumberColumn], chosen: Mapping[str, NumberColumn]) -> str:
    """Return which of force and position no column can be, and which columns are another quantity."""
    roles = {*chosen, *(one.role for one in series if does_move(one))}
    missing = [role for role in ("force", "position") if not roles & {role, None}] or ["force", "position"]
    taken = {one.key for one in chosen.values()}
    others = [int(one.key[1]) for one in series if one.role == "other" and one.key not in taken]
    named = [sheet.names[k] for k in others if sheet.unit(k) is not None or role_by_words(sheet.names[k]) == "other"]
    shown = ", ".join(map(column_text, named[:_OTHERS])) + (", ..." if len(named) > _OTHERS else "")
    about = f"; by name or unit an angle, a torque or another quantity: {shown}" if named else ""
    options = ", ".join(f"--{role}" for role in missing)
    words = f"no column can be the {missing[0]}" if len(missing) == 1 else "no two columns can be force and position"
    return f"{words}; choose with {options} (there are: {sheet.columns}){about}"


def _other_trials(found: RoleGuess, sheet: Sheet) -> dict[str, tuple[str, ...]]:
    """By role, columns that differ by a number in their names only and serve as well: several presses in one table."""
    trials: dict[str, tuple[str, ...]] = {}
    for role, pick in found.picks.items():
        indices = [int(series.key[1]) for series in (pick.series, *pick.others)]
        stems = [re.sub(r"\d+", "", sheet.names[k]) for k in indices]
        alike = [sheet.names[k] for k, stem in zip(indices, stems) if stem == stems[0] and sheet.header]
        if len(alike) > 1 and "chosen" not in pick.why:
            trials[role] = tuple(sorted(alike))
    return trials


def _columns(
    found: RoleGuess,
    sheet: Sheet,
    units: Mapping[str, str],
    unscaled: Collection[str],
    choices: Mapping[str, str],
    blanks: list[str],
) -> dict[str, dict[str, Any]]:
    """The columns by role; what one of a unit is that only a person knows, is a blank."""
    columns: dict[str, dict[str, Any]] = {}
    for role, pick in found.picks.items():
        k = int(pick.series.key[1])
        columns[role] = {"column": sheet.column(k), "unit": units[role]}
        if (scale := sheet.scale(k)) != 1.0:
            columns[role]["scale"] = scale
        if role not in unscaled:
            continue
        key = f"columns.{role}.scale"
        try:
            columns[role]["scale"] = float(choices[key]) if key in choices else "?"
        except ValueError as error:
            raise LogError(f"{sheet.path}: {key} = {choices[key]!r}: expected a number") from error
        if key not in choices:
            per = f"how many {units[role]} one {sheet.written_unit(k) or 'unit'} of {pick.series.label} is"
            blanks.append(f"{key}: {per}")
    return columns


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


def _chosen(sheet: Sheet, values: Floats, series: Sequence[NumberColumn], role: str, text: str) -> NumberColumn:
    k = sheet.index_of(role, text.removeprefix(":"))
    sheet.demand_numbers(role, k, values[:, k])
    for mine in series:
        if mine.key[1] == str(k):
            return replace(mine, role=role, why="chosen")
    raise LogError(f"{sheet.path}: --{role}: column {column_text(text)} is the time, or counts the rows")
