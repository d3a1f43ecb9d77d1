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

_NUMBERS = ("value", "std", "reference", "reference_std")
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
    remarks: tuple[str, ...] = ()  # why the two are perhaps not comparable
    run: Path | None = None

    @property
    def difference(self) -> float:
        """Value minus reference."""
        return self.value - self.reference

    @property
    def difference_std(self) -> float:
        """Its standard uncertainty."""
        return math.hypot(self.std, self.reference_std)


@dataclass(frozen=True)
class ReferenceValue:
    """What a reference says at the conditions of a run [SI]."""

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
    rows = [line for line in text.lines if any(line.cells) and not line.cell(0).startswith("#")]
    if len(rows) < 2:
        raise LogError(f"{path}: has no rows below its names")
    names, units = _heads(path, rows[0], unit)
    wanted = {"specimen", *_NUMBERS} - ({"value", "std"} if "run" in names else set())
    if missing := sorted(wanted - set(names)):
        known = f"{suggest(missing[0], names)}; required: specimen, run or value and std, reference, reference_std"
        raise LogError(f"{path}:{rows[0].number}: the column {missing[0]!r} is missing{known}")
    return [_pair(text, line, dict(zip(names, line.cells, strict=False)), units, quantity, track) for line in rows[1:]]


def _heads(path: Path, head: TextLine, unit: str) -> tuple[list[str], dict[str, float]]:
    """Names without units, and what one of each is in SI; raises LogError for a number without one."""
    names, factors = [], {}
    for column, cell in enumerate(head.cells, 1):
        plain, written = name_and_unit(cell)
        name = plain.strip().lower().replace(" ", "_")
        names.append(name)
        if name in _NUMBERS:
            at = f"{path}:{head.number}, column {column} {cell!r}"
            if not written:
                raise LogError(f'{at}: has no unit; write for example "{name} [kPa]"')
            try:
                factors[name] = to_si(f"1 {written}", unit)
            except ValueError as error:
                raise LogError(f"{at}: {error}") from error
    return names, factors


def _pair(
    text: InstrumentText,
    line: TextLine,
    row: Mapping[str, str],
    units: Mapping[str, float],
    quantity: str,
    track: str | None,
) -> ValuePair:
    numbers = {}
    for name in units:
        cell = row.get(name, "")
        at = f"{text.path}:{line.number}, column {name!r}: {cell!r}"
        try:
            numbers[name] = text.number(cell) * units[name]
        except ValueError as error:
            raise LogError(f"{at} is not a number") from error
        if not math.isfinite(numbers[name]) or (name.endswith("std") and numbers[name] <= 0):
            raise LogError(f"{at} is not a number above zero, as an uncertainty is")
    run, label = None, f"row {line.number}"
    if "run" in row:
        run = text.path.parent / row["run"].strip()
        (found,) = run_values(run, (quantity,), track)
        numbers |= {"value": found.value, "std": found.std}
        label = row["run"].strip()
    factors = {name: row[name].strip() for name in FACTORS if row.get(name, "").strip()}
    return ValuePair(
        label, row["specimen"].strip(), numbers["value"], numbers["std"], numbers["reference"],
        numbers["reference_std"], factors, run=run,
    )  # fmt: skip


def run_pairs(runs: Sequence[Path], quantity: str, track: str | None, reference: ReferenceOf) -> list[ValuePair]:
    """Runs on one specimen, each against the reference at its own conditions; their days are a factor."""
    found = []
    for path in runs:
        (value,) = run_values(path, (quantity,), track)
        known = reference(value.conditions, value.poisson)
        found.append(
            ValuePair(
                path.name, known.name, value.value, value.std, known.value, known.std,
                {"day": f"{value.started:%Y-%m-%d}"}, known.remarks, path,
            )
        )  # fmt: skip
    return found
