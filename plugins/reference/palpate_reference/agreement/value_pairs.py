"""Pairs of a palpated value and that of a reference: from runs, or from a table with a row for each."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from palpate import LogError, suggest, to_si

from palpate_reference.instrument_text import InstrumentText, TextLine, read_text
from palpate_reference.run_values import Conditions, run_values
from palpate_reference.table_columns import name_and_unit

_NUMBER_COLUMNS = ("value", "std", "reference", "reference_std")
FACTORS = ("operator", "day", "rig", "laboratory", "tip")


@dataclass(frozen=True)
class ValuePair:
    """A value and its reference [SI]."""

    label: str
    specimen: str
    value: float
    std: float
    reference: float
    reference_std: float
    factors: Mapping[str, str] = field(default_factory=dict)  # by which values of a specimen differ: operator, day, ...
    remarks: tuple[str, ...] = ()  # reasons why the two may not be comparable
    run: Path | None = None

    @property
    def difference(self) -> float:
        """Value minus reference."""
        return self.value - self.reference

    @property
    def difference_std(self) -> float:
        """Standard uncertainty of the difference."""
        return math.hypot(self.std, self.reference_std)


@dataclass(frozen=True)
class ReferenceValue:
    """The value of a reference at the conditions of a run [SI]."""

    name: str
    value: float
    std: float
    remarks: tuple[str, ...] = ()


ReferenceOf = Callable[[Conditions, float], ReferenceValue]  # at the conditions of a run, for its Poisson's ratio


def table_pairs(path: Path, quantity: str, unit: str, track: str | None) -> list[ValuePair]:
    """Return the rows of a CSV: specimen, value, std, reference, reference_std with units in their names, and factors.

    A column `run` stands for value and std: a run folder, relative to the file. Raises UserError with line and column.
    """
    text = read_text(path)
    lines = [line for line in text.lines if any(line.cells) and not line.cell(0).startswith("#")]
    if len(lines) < 2:
        raise LogError(f"{path}: has no rows below its names")
    heading, *rows = lines
    names, factors = _names_and_factors(path, heading, unit)
    required = {"specimen", *_NUMBER_COLUMNS} - ({"value", "std"} if "run" in names else set())
    missing = sorted(required - set(names))
    if missing:
        hint = f"{suggest(missing[0], names)}; required: specimen, run or value and std, reference, reference_std"
        raise LogError(f"{path}:{heading.number}: the column {missing[0]!r} is missing{hint}")
    return [_pair(text, row, dict(zip(names, row.cells, strict=False)), factors, quantity, track) for row in rows]


def _names_and_factors(path: Path, heading: TextLine, unit: str) -> tuple[list[str], dict[str, float]]:
    """Return the names of all columns without units, and the factor to SI of each column of numbers.

    Raises LogError for a column of numbers without a unit of the kind of `unit`.
    """
    names, factors = [], {}
    for column, cell in enumerate(heading.cells, 1):
        plain_name, stated_unit = name_and_unit(cell)
        name = plain_name.strip().lower().replace(" ", "_")
        names.append(name)
        if name not in _NUMBER_COLUMNS:
            continue
        cell_place = f"{path}:{heading.number}, column {column} {cell!r}"
        if not stated_unit:
            raise LogError(f'{cell_place}: has no unit; write for example "{name} [kPa]"')
        try:
            factors[name] = to_si(f"1 {stated_unit}", unit)
        except ValueError as error:
            raise LogError(f"{cell_place}: {error}") from error
    return names, factors


def _pair(
    text: InstrumentText,
    line: TextLine,
    cells: Mapping[str, str],
    factors: Mapping[str, float],
    quantity: str,
    track: str | None,
) -> ValuePair:
    """Return the pair of a row, by its cells and the factors to SI of its numbers, both by column; raises UserError."""
    numbers = {name: _number(text, line, name, cells.get(name, "")) * factor for name, factor in factors.items()}
    run, label = None, f"row {line.number}"
    if "run" in cells:
        label = cells["run"].strip()
        run = text.path.parent / label
        (run_value,) = run_values(run, (quantity,), track)
        numbers |= {"value": run_value.value, "std": run_value.std}
    return ValuePair(
        label,
        cells["specimen"].strip(),
        value=numbers["value"],
        std=numbers["std"],
        reference=numbers["reference"],
        reference_std=numbers["reference_std"],
        factors={name: cells[name].strip() for name in FACTORS if cells.get(name, "").strip()},
        run=run,
    )


def _number(text: InstrumentText, line: TextLine, name: str, cell: str) -> float:
    """Return the number in a cell; raises LogError for any other, and for an uncertainty that is not above zero."""
    cell_place = f"{text.path}:{line.number}, column {name!r}: {cell!r}"
    try:
        number = text.number(cell)
    except ValueError as error:
        raise LogError(f"{cell_place} is not a number") from error
    if not math.isfinite(number) or (name.endswith("std") and number <= 0):
        raise LogError(f"{cell_place} is not a number above zero, as an uncertainty is")
    return number


def run_pairs(runs: Sequence[Path], quantity: str, track: str | None, reference_of: ReferenceOf) -> list[ValuePair]:
    """Return runs on one specimen, each against the reference at its own conditions; their days are a factor."""
    pairs = []
    for path in runs:
        (run_value,) = run_values(path, (quantity,), track)
        reference = reference_of(run_value.conditions, run_value.poisson)
        pairs.append(
            ValuePair(
                path.name,
                reference.name,
                value=run_value.value,
                std=run_value.std,
                reference=reference.value,
                reference_std=reference.std,
                factors={"day": f"{run_value.started:%Y-%m-%d}"},
                remarks=reference.remarks,
                run=path,
            )
        )
    return pairs
