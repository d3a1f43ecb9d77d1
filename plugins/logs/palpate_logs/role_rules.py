"""Rules for the role of a column of a table: a force, a height, a velocity, the time, or another quantity."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from palpate import Floats
from palpate_kit.logs.role_guess import ROLES
from palpate_records.messages.readings import si_unit
from palpate_records.tables.csv_names import (
    contradicts,
    exact_role,
    is_another_quantity,
    is_depth,
    is_of_retraction,
    is_spread,
    role_by_words,
    symbol_role,
)
from palpate_records.tables.csv_sheet import Sheet
from palpate_records.tables.rules import Sureness, rule

from palpate_logs.csv_pose import sideways_forces, turning_elements
from palpate_logs.csv_units import DIMENSIONS

OTHER = "other"  # the role of a column that is certainly no force, height or velocity
Claims = Sequence[str | None]  # roles by column; None if a rule does not say


@dataclass(frozen=True)
class TableColumns:
    """The columns of a table, and the roles that the rules before gave them."""

    sheet: Sheet
    values: Floats  # (n, columns)
    roles: Claims = ()

    @property
    def names(self) -> Sequence[str]:
        """The names of the columns."""
        return self.sheet.names

    @cached_property
    def role_of_units(self) -> Claims:
        """The roles that the units state, `OTHER` for a unit of another quantity; None without a unit."""
        units = [self.sheet.unit(k) for k in range(len(self.names))]
        return [DIMENSIONS.get(si_unit(unit)[0], OTHER) if unit else None for unit in units]


@rule("words of a name next to the unit", "another quantity, as a gripper's width", Sureness.STATED)
def name_of_another_quantity(columns: TableColumns) -> Claims:
    """Return `OTHER` where a word excludes the role that the unit states."""
    claims: list[str | None] = []
    for name, unit_role in zip(columns.names, columns.role_of_units, strict=True):
        is_other = unit_role != "force" and is_another_quantity(name)
        is_contradicted = unit_role in ("force", "position") and contradicts(name, unit_role)
        claims.append(OTHER if is_other or is_contradicted else None)
    return claims


@rule("the unit", "force, height, velocity or another quantity", Sureness.STATED)
def unit_of_column(columns: TableColumns) -> Claims:
    """Return the roles that units state."""
    return columns.role_of_units


@rule("the whole name", "force, height, velocity or time", Sureness.STATED)
def whole_name(columns: TableColumns) -> Claims:
    """Return the roles of names such as "Fz" or "z"."""
    return [exact_role(name) for name in columns.names]


@rule("a word of the name", "force, height, velocity or another quantity", Sureness.WORD)
def word_of_name(columns: TableColumns) -> Claims:
    """Return the roles of words such as "Standardkraft"."""
    roles = [role_by_words(name) for name in columns.names]
    return [role if role in (*ROLES, OTHER) else None for role in roles]


@rule("the usual symbol", "force, height or velocity", Sureness.GUESS)
def symbol_of_quantity(columns: TableColumns) -> Claims:
    """Return the roles of symbols such as "<F>" or "d_mean"."""
    return [symbol_role(name) for name in columns.names]


@rule("a depth among heights", "the other heights, which the depth resembles, and a depth of zeros", Sureness.WORD)
def heights_next_to_depth(columns: TableColumns) -> Collection[int]:
    """Return the heights next to a depth.

    A depth of zeros does not count: its instrument works it out later, if at all.
    """
    heights = {column for column, role in enumerate(columns.roles) if role == "position"}
    named_depths = [column for column in heights if is_depth(columns.names[column])]
    depths = {column for column in named_depths if float(np.nanmax(np.abs(columns.values[:, column]), initial=0)) > 0.0}
    return heights - depths if depths else ()


@rule("words such as std", "the scatter of a force next to the force, in whose unit it is", Sureness.WORD)
def scatter_of_force(columns: TableColumns) -> Collection[int]:
    """Return the columns of scatter, unless no other column is a force, as a microscope's deflection error alone."""
    scatter = {column for column, name in enumerate(columns.names) if is_spread(name)}
    forces = {column for column, role in enumerate(columns.roles) if role == "force"}
    return scatter if forces - scatter else ()


@rule("words such as retract", "columns of the way back, next to those of the way in", Sureness.WORD)
def columns_of_retraction(columns: TableColumns) -> Collection[int]:
    """Return the columns of the retraction, unless all columns are."""
    retraction = [column for column, name in enumerate(columns.names) if is_of_retraction(name)]
    return retraction if len(retraction) < len(columns.names) else ()


@rule("three axes of a force", "the two axes that change less", Sureness.GUESS)
def axes_of_less_force(columns: TableColumns) -> Collection[int]:
    """Return the axes along which the tip does not press."""
    return sideways_forces(columns.names, columns.roles, columns.values)


@rule("six numbered elements", "elements 3 to 5: torques, angles and joints", Sureness.WORD)
def elements_that_turn(columns: TableColumns) -> Collection[int]:
    """Return the elements of wrenches and poses that turn."""
    return turning_elements(columns.names)


CLAIM_RULES = (name_of_another_quantity, unit_of_column, whole_name, word_of_name, symbol_of_quantity)
EXCLUSION_RULES = (
    heights_next_to_depth,
    scatter_of_force,
    columns_of_retraction,
    axes_of_less_force,
    elements_that_turn,
)


def column_roles(sheet: Sheet, values: Floats) -> list[str | None]:
    """Return the role of each column, by its unit, name and symbol; None if nothing states one.

    The surest rule counts. A role that a surer rule gave to any column is not given again. Exclusions come last.
    """
    columns = TableColumns(sheet, values)
    roles: list[str | None] = [None] * len(sheet.names)
    for sureness in sorted(Sureness, reverse=True):
        assigned = {*roles} - {OTHER}
        for claim_rule in CLAIM_RULES:
            # Of equally sure rules the first one counts.
            if claim_rule.sureness == sureness:
                new_claims = [None if claim in assigned else claim for claim in claim_rule(columns)]
                roles = [role or claim for role, claim in zip(roles, new_claims)]
    for exclusion_rule in EXCLUSION_RULES:
        excluded = exclusion_rule(TableColumns(sheet, values, roles))
        roles = [OTHER if column in excluded else role for column, role in enumerate(roles)]
    return roles
