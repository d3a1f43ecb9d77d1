"""The unit of replication of curves, such as an animal: the column of ``curves.csv`` by whose values groups compare."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

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
    """Groups of curves by a column, in the order of their names, compared by a parameter [SI] of their usable rows.

    The rows are of one track. Raises ConfigurationError for an unknown unit.
    """
    groups: dict[str, list[CurveRow]] = {}
    for row in rows:
        groups.setdefault((row.groups.get(by) or NO_GROUP) if by else "curves", []).append(row)
    groups = {name: groups[name] for name in sorted(groups, key=natural)}
    chosen = replication_unit({name: [row.groups for row in found] for name, found in groups.items()}, unit)
    values = {
        name: [
            (unit_of(row.curve, row.groups, chosen), value)
            for row in found
            if row.usable and (value := row.usable_number(parameter)) is not None
        ]
        for name, found in groups.items()
    }
    return compare_groups({name: found for name, found in values.items() if found}, chosen, mixed)


def unit_of(curve: str, cells: Cells, unit: str) -> str:
    """Return the unit that a curve belongs to; raises ConfigurationError where ``curves.csv`` does not say."""
    if unit == CURVE:
        return curve
    if not cells.get(unit):
        raise ConfigurationError(
            f"{curve}: curves.csv does not say of which {unit} it is: enter it there, reject the curve, or compare "
            f"single curves by --unit {CURVE}"
        )
    return cells[unit]


def replication_unit(groups: Mapping[str, Sequence[Cells]], unit: str | None = None) -> str:
    """Return the column that names the units of groups of curves; `curve` where each curve is one.

    By default the column with at least two values in each group whose values lie in one group each; of several the
    coarsest. Raises ConfigurationError where none of them is the coarsest, and for a given `unit` that is not such a
    column.
    """
    everything = [cells for of_group in groups.values() for cells in of_group]
    columns = columns_of(everything)
    if unit is not None:
        return _demand_unit(groups, columns, unit)
    found = [name for name in columns if name not in (*PLACES, *FACTS) and _names_units(groups, name)]
    if len(groups) < 2 or not found:
        return CURVE
    for coarse in found:
        if all(_lies_within(fine, coarse, everything) for fine in found):
            return coarse
    one, other = next(
        (a, b) for a in found for b in found if not (_lies_within(a, b, everything) or _lies_within(b, a, everything))
    )
    raise ConfigurationError(
        f"{one} and {other} of curves.csv may both name the units that are compared, and neither lies within the "
        f"other: give --unit {one} or --unit {other}"
    )


def shared_units(groups: Mapping[str, Sequence[Cells]], column: str) -> list[str]:
    """Return the values of `column` that occur in more than one group, in order of first occurrence."""
    of_group = [dict.fromkeys(cells.get(column) or "" for cells in found) for found in groups.values()]
    counts = Counter(value for values in of_group for value in values if value)
    return [value for value, count in counts.items() if count > 1]


def _names_units(groups: Mapping[str, Sequence[Cells]], column: str) -> bool:
    """Return True if a column has at least two values in each group, and each value in one group."""
    several = all(len({cells.get(column) or "" for cells in found} - {""}) > 1 for found in groups.values())
    return several and not shared_units(groups, column)


def _lies_within(fine: str, coarse: str, curves: Sequence[Cells]) -> bool:
    """Return True if the curves of each value of one column have one value of another."""
    found: dict[str, set[str]] = {}
    for cells in curves:
        if cells.get(fine) and cells.get(coarse):
            found.setdefault(cells[fine], set()).add(cells[coarse])
    return all(len(values) == 1 for values in found.values())


def _demand_unit(groups: Mapping[str, Sequence[Cells]], columns: Sequence[str], unit: str) -> str:
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
