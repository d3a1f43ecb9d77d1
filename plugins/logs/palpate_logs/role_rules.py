"""Rules for what a column of a table is: a force, a height, a velocity, the time, or another quantity."""

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

OTHER = "other"  # what a column is that is certainly no force, height or velocity
Claims = Sequence[str | None]  # by column


@dataclass(frozen=True)
class TableColumns:
    """The columns of a table, and what is known of them."""

    sheet: Sheet
    values: Floats  # (n, columns)
    roles: Claims = ()  # by the rules that came before

    @property
    def names(self) -> Sequence[str]:
        """The names."""
        return self.sheet.names

    @cached_property
    def role_of_units(self) -> Claims:
        """The roles that the units state; None without a unit."""
        units = [self.sheet.unit(k) for k in range(len(self.names))]
        return [DIMENSIONS.get(si_unit(unit)[0], OTHER) if unit else None for unit in units]


@rule("words of a name next to the unit", "another quantity, as a gripper's width", Sureness.STATED)
def name_of_another_quantity(columns: TableColumns) -> Claims:
    """Return `OTHER` where a word excludes the role that the unit states."""
    return [
        OTHER
        if (is_another_quantity(name) and role != "force")
        or (role in ("force", "position") and contradicts(name, role))
        else None
        for name, role in zip(columns.names, columns.role_of_units, strict=True)
    ]


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
    """Return the heights next to a depth; a depth of zeros is of an instrument that works it out later, if at all."""
    heights = [k for k, role in enumerate(columns.roles) if role == "position"]
    depths = [
        k
        for k in heights
        if is_depth(columns.names[k]) and float(np.nanmax(np.abs(columns.values[:, k]), initial=0)) > 0.0
    ]
    return {*heights} - {*depths} if depths else ()


@rule("words such as std", "the scatter of a force next to the force, in whose unit it is", Sureness.WORD)
def scatter_of_force(columns: TableColumns) -> Collection[int]:
    """Return the columns of scatter, unless no other column is a force, as a microscope's deflection error alone."""
    scatter = {k for k, name in enumerate(columns.names) if is_spread(name)}
    forces = {k for k, role in enumerate(columns.roles) if role == "force"}
    return scatter if forces - scatter else ()


@rule("words such as retract", "columns of the way back, next to those of the way in", Sureness.WORD)
def columns_of_retraction(columns: TableColumns) -> Collection[int]:
    """Return the columns of the way back, unless all are."""
    back = [k for k, name in enumerate(columns.names) if is_of_retraction(name)]
    return back if len(back) < len(columns.names) else ()


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
    """Return what each column is by the surest rule; a role that a column has more surely goes to no other."""
    columns = TableColumns(sheet, values)
    roles: list[str | None] = [None] * len(sheet.names)
    for sureness in sorted(Sureness, reverse=True):
        assigned = {*roles} - {OTHER}
        for claim_rule in CLAIM_RULES:
            if claim_rule.sureness == sureness:
                claims = claim_rule(columns)
                roles = [role or (None if claim in assigned else claim) for role, claim in zip(roles, claims)]
    for exclusion_rule in EXCLUSION_RULES:
        excluded = exclusion_rule(TableColumns(sheet, values, roles))
        roles = [OTHER if k in excluded else role for k, role in enumerate(roles)]
    return roles
