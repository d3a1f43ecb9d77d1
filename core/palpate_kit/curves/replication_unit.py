"""The unit of replication of curves, such as an animal: the column of ``curves.csv`` by whose values groups compare."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import product

from palpate import ConfigurationError, suggest

from palpate_kit.curves.curve_list import FACTS, PLACES, columns_of
from palpate_kit.curves.curve_row import CurveRow
from palpate_kit.numerics.group_comparison import CURVE, GroupComparison, compare_groups
from palpate_kit.runs.run_groups import natural

Cells = Mapping[str, str]  # of a curve, by column
NO_GROUP = "none"  # of curves without a cell in the column of the groups


def compare_rows(
    rows: Iterable[CurveRow], parameter: str, by: str | None, unit: str | None = None, mixed: bool = False
) -> GroupComparison:
    """Compare groups of curves by a parameter [SI] of their usable rows, which are of one track.

    The groups are the values of the column `by`, in the order of their names; without one all curves are one group.
    `unit` is the column of the units of replication, `mixed` asks for a mixed model in place of Welch's test. Raises
    ConfigurationError for an unknown unit.
    """
    groups: dict[str, list[CurveRow]] = {}
    for row in rows:
        group_name = (row.groups.get(by) or NO_GROUP) if by else "curves"
        groups.setdefault(group_name, []).append(row)
    groups = {name: groups[name] for name in sorted(groups, key=natural)}
    unit_column = replication_unit({name: [row.groups for row in members] for name, members in groups.items()}, unit)
    # Unit and value of each usable row.
    values: dict[str, list[tuple[str, float]]] = {}
    for name, members in groups.items():
        for row in members:
            value = row.usable_number(parameter) if row.usable else None
            if value is not None:
                unit_and_value = unit_of(row.curve, row.groups, unit_column), value
                values.setdefault(name, []).append(unit_and_value)
    return compare_groups(values, unit_column, mixed)


def unit_of(curve: str, cells: Cells, unit: str) -> str:
    """Return the unit that a curve belongs to; raises ConfigurationError if ``curves.csv`` does not say."""
    if unit == CURVE:
        return curve
    if not cells.get(unit):
        raise ConfigurationError(
            f"{curve}: curves.csv does not say of which {unit} it is: enter it there, reject the curve, or compare "
            f"single curves by --unit {CURVE}"
        )
    return cells[unit]


def replication_unit(groups: Mapping[str, Sequence[Cells]], unit: str | None = None) -> str:
    """Return the column that names the units of groups of curves; `curve` if each curve is a unit.

    By default the column with at least two values in each group, each of which lies in one group; of several such
    columns the coarsest, within whose values those of all others lie; `curve` without one, and for a single group.
    Raises ConfigurationError if none of several is the coarsest, and for a stated `unit` that is not such a column.
    """
    curves = [cells for members in groups.values() for cells in members]
    columns = columns_of(curves)
    if unit is not None:
        return _demand_unit(groups, columns, unit)
    candidates = [name for name in columns if name not in (*PLACES, *FACTS) and _names_units(groups, name)]
    if len(groups) < 2 or not candidates:
        return CURVE
    # The coarsest column: the values of all others lie within its values.
    for coarse in candidates:
        if all(_lies_within(fine, coarse, curves) for fine in candidates):
            return coarse
    first, second = _crossing_columns(candidates, curves)
    raise ConfigurationError(
        f"{first} and {second} of curves.csv may both name the units that are compared, and neither lies within the "
        f"other: give --unit {first} or --unit {second}"
    )


def _crossing_columns(columns: Sequence[str], curves: Sequence[Cells]) -> tuple[str, str]:
    """Return the first two columns of which neither lies within the other."""
    return next(
        (first, second)
        for first, second in product(columns, repeat=2)
        if not (_lies_within(first, second, curves) or _lies_within(second, first, curves))
    )


def shared_units(groups: Mapping[str, Sequence[Cells]], column: str) -> list[str]:
    """Return the values of `column` that occur in more than one group, in order of first occurrence."""
    values_by_group = [dict.fromkeys(cells.get(column) or "" for cells in curves) for curves in groups.values()]
    counts = Counter(value for values in values_by_group for value in values if value)
    return [value for value, count in counts.items() if count > 1]


def _names_units(groups: Mapping[str, Sequence[Cells]], column: str) -> bool:
    """Return True if a column has at least two values in each group, and each value in one group."""
    values_by_group = [{cells.get(column) or "" for cells in curves} - {""} for curves in groups.values()]
    return all(len(values) > 1 for values in values_by_group) and not shared_units(groups, column)


def _lies_within(fine: str, coarse: str, curves: Sequence[Cells]) -> bool:
    """Return True if all curves with one value of the fine column have one value of the coarse column."""
    coarse_values: dict[str, set[str]] = {}  # by fine value
    for cells in curves:
        if cells.get(fine) and cells.get(coarse):
            coarse_values.setdefault(cells[fine], set()).add(cells[coarse])
    return all(len(values) == 1 for values in coarse_values.values())


def _demand_unit(groups: Mapping[str, Sequence[Cells]], columns: Sequence[str], unit: str) -> str:
    """Return a stated unit; raises ConfigurationError for an unknown column, and for one whose values groups share."""
    if unit == CURVE:
        return unit
    if unit not in columns:
        raise ConfigurationError(f"--unit {unit}: curves.csv has no such column{suggest(unit, [CURVE, *columns])}")
    if shared := shared_units(groups, unit):
        raise ConfigurationError(
            f"--unit {unit}: {shared[0]} lies in several groups, and a unit lies in one: call units of different "
            "groups by different names; groups that share their units are not compared"
        )
    return unit
