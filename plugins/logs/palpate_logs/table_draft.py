"""A file whose columns have roles, with the tables of a pipeline and the sentences that the rules make of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats
from palpate_kit.logs.role_guess import NumberColumn, RoleGuess
from palpate_records.messages.readings import si_unit
from palpate_records.tables.csv_clock import TimeColumn
from palpate_records.tables.csv_sheet import Sheet

from palpate_logs.csv_units import needs_scale


@dataclass
class TableDraft:
    """A file, the roles of its columns, and the tables and sentences that the rules make of them."""

    path: Path
    choices: Mapping[str, str]  # of a person: columns by role, keys of the device, facts
    sheet: Sheet
    values: Floats  # (n, columns) as recorded
    clock: TimeColumn | None
    series: Sequence[NumberColumn]  # columns that can have a role
    roles: RoleGuess
    bends: Sequence[NumberColumn]  # lengths by which a beam yields under the force
    units: Mapping[str, str]  # by role
    unit_guesses: Mapping[str, str]  # by role: a sentence on a unit that is a guess
    device: dict[str, Any] = field(default_factory=dict)  # its table
    alignment: dict[str, Any] = field(default_factory=dict)  # its table
    rivals: dict[str, tuple[str, ...]] = field(default_factory=dict)  # by role: columns that can have it
    rate: float | None = None  # [Hz] where no column is the time
    sweep_speed: float | None = None  # [m/s] of the tip along the skin, NaN without a time; None of a point
    reasons: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)  # guesses that a person should check
    blanks: list[str] = field(default_factory=list)  # keys that a person must state
    hints: list[str] = field(default_factory=list)

    @property
    def seconds(self) -> Floats | None:
        """The time of each row (n,) [s]; None without a time and a rate."""
        if self.clock is not None:
            return self.clock.seconds
        return np.arange(len(self.values)) / self.rate if self.rate is not None else None

    def index(self, role: str) -> int:
        """Return the index of the column of a role."""
        return int(self.roles.picks[role].series.key[1])

    @cached_property
    def unscaled(self) -> set[str]:
        """The roles of which only a person knows how much one number is."""
        return {role for role, pick in self.roles.picks.items() if needs_scale(self.sheet, pick, role)}

    @cached_property
    def factors(self) -> dict[str, float]:
        """The size of one number of a role in SI."""
        return {role: si_unit(unit)[1] * self.sheet.scale(self.index(role)) for role, unit in self.units.items()}

    @property
    def words(self) -> dict[str, Sequence[str]]:
        """The sentences by kind: reasons, doubts, blanks and hints."""
        return {"reasons": self.reasons, "doubts": self.doubts, "blanks": self.blanks, "hints": self.hints}
