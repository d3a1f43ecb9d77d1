"""A file whose columns have roles, and what the rules make of it: the tables of a pipeline, and words."""

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
    """A file, the roles of its columns, and the tables and words that the rules make of them."""

    path: Path
    choices: Mapping[str, str]
    sheet: Sheet
    values: Floats  # (n, columns)
    clock: TimeColumn | None
    series: Sequence[NumberColumn]
    roles: RoleGuess
    bends: Sequence[NumberColumn]  # lengths by which a beam yields
    units: Mapping[str, str]  # by role
    unit_guesses: Mapping[str, str]  # what is said of those that are guesses
    device: dict[str, Any] = field(default_factory=dict)
    alignment: dict[str, Any] = field(default_factory=dict)
    rivals: dict[str, tuple[str, ...]] = field(default_factory=dict)
    rate: float | None = None  # [Hz] where no column is the time
    sweep_speed: float | None = None  # [m/s] of the tip along the skin, NaN without a time; None of a point
    reasons: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    blanks: list[str] = field(default_factory=list)
    hints: list[str] = field(default_factory=list)

    @property
    def seconds(self) -> Floats | None:
        """Time of each row (n,) [s]; None without a time and a rate."""
        if self.clock is not None:
            return self.clock.seconds
        return np.arange(len(self.values)) / self.rate if self.rate is not None else None

    def index(self, role: str) -> int:
        """Return the column of a role."""
        return int(self.roles.picks[role].series.key[1])

    @cached_property
    def unscaled(self) -> set[str]:
        """Roles of which only a person knows how much one number is."""
        return {role for role, pick in self.roles.picks.items() if needs_scale(self.sheet, pick, role)}

    @cached_property
    def factors(self) -> dict[str, float]:
        """The size of one number of a role in SI."""
        return {role: si_unit(unit)[1] * self.sheet.scale(self.index(role)) for role, unit in self.units.items()}

    @property
    def words(self) -> dict[str, Sequence[str]]:
        """Reasons, doubts, blanks and hints."""
        return {"reasons": self.reasons, "doubts": self.doubts, "blanks": self.blanks, "hints": self.hints}
