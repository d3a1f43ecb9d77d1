"""A thickness factor from a file: depths and factors, with their specimen and tip."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats, Indenter
from palpate_engine import bounded_text, json_document

_HEAD = ["depth [m]", "factor"]
_DEGREE = 4  # a choice: of the polynomial in the square root of the depth
_SMOOTHING_DEGREE = 3  # a choice: the same, through rows that are scattered by the elements
MIN_ROWS = 5  # a choice: one row more than the polynomial has coefficients
_MAX_MISFIT = 5e-3  # a choice: relative difference of the polynomial to a row


@dataclass(frozen=True)
class ThicknessTable:
    """c(d) = sum of c_i (d/d_max)^(i/2), with c_0 = 1 but for flat tips, and its specimen and tip."""

    facts: dict[str, Any]
    deepest: float  # [m]
    coefficients: tuple[float, ...]
    worst: float  # relative difference of the polynomial to a row
    at_touch: float = 1.0  # c_0

    def factor(self, depth: Any) -> tuple[Any, Any]:
        """Return c(d), and d c'(d)."""
        x = (depth / self.deepest) ** 0.5
        value, slope, power = self.at_touch, 0.0, 1.0
        for i, coefficient in enumerate(self.coefficients, start=1):
            power = power * x
            value = value + coefficient * power
            slope = slope + 0.5 * i * coefficient * power
        return value, slope

    def refuse(self, indenter: Indenter) -> None:
        """Raise ValueError where the table is of another tip."""
        tip, table_tip = tip_facts(indenter), self.facts.get("tip")
        if table_tip is not None and tip != table_tip:
            raise ValueError(f"thickness: the table is for the tip {json.dumps(table_tip)}, not for {json.dumps(tip)}")


def tip_facts(indenter: Indenter) -> dict[str, Any]:
    """Return type and sizes of a tip as plain data."""
    return {"type": type(indenter).__name__, **json.loads(indenter.model_dump_json())}


def table_text(facts: dict[str, Any], depths: Floats, factors: Floats) -> str:
    """Return the text of a table's file; facts stand in lines that begin with #."""
    lines = [f"# {name} = {json.dumps(value)}" for name, value in facts.items()]
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(
        [_HEAD, *([f"{d:.9g}", f"{c:.9g}"] for d, c in zip(depths.tolist(), factors.tolist(), strict=True))]
    )
    return "\n".join(lines) + "\n" + text.getvalue()


@cache
def read_table(path: Path) -> ThicknessTable:
    """Return the table of depths [m] and factors in a CSV file; raises ValueError, which names the file, else."""
    try:
        lines = bounded_text(path).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"table {path}: cannot be read: {error}") from error
    rows = list(csv.reader(line for line in lines if line.strip() and not line.startswith("#")))
    if not rows or rows[0] != _HEAD:
        raise ValueError(f"table {path}: its first line is not {','.join(_HEAD)}")
    try:
        numbers = np.array([[float(cell) for cell in row] for row in rows[1:]])
    except ValueError as error:
        raise ValueError(f"table {path}: {error}") from error
    if numbers.ndim != 2 or numbers.shape[1] != 2 or len(numbers) < MIN_ROWS:
        raise ValueError(f"table {path}: {MIN_ROWS} rows of a depth and a factor are needed")
    depth, factor = numbers.T
    if not np.isfinite(numbers).all() or np.any(depth <= 0) or np.any(np.diff(depth) <= 0) or np.any(factor <= 0):
        raise ValueError(f"table {path}: depths have to rise from above 0, and factors to be above 0")
    return _fit_table(_facts(lines), depth, factor, path)


def _facts(lines: list[str]) -> dict[str, Any]:
    """Return the facts of the lines that begin with #, name = JSON; other text stays text."""
    facts: dict[str, Any] = {}
    for line in lines:
        if not line.startswith("#"):
            continue
        name, equals, value = line[1:].partition("=")
        try:
            facts[name.strip()] = json_document(value) if equals else None
        except ValueError:
            facts[name.strip()] = value.strip()
    return facts


def smooth_table(depths: Floats, factors: Floats, flat: bool = False) -> tuple[Floats, float, float]:
    """Return the curve of a table at its depths, its largest relative difference to a row, and c_0.

    A flat tip touches with all of its face at once: its c_0 is the limit of the rows, by a line in the depth.
    """
    at_touch = 1.0
    if flat:
        at_touch = float(np.polynomial.Polynomial.fit(depths, factors, 1)(0.0))
    _, curve, misfit = _curve(depths, factors, _SMOOTHING_DEGREE, at_touch)
    return curve, misfit, at_touch


def _curve(depth: Floats, factor: Floats, degree: int, at_touch: float) -> tuple[Floats, Floats, float]:
    """Return coefficients c_i, curve (n,) and largest relative difference, by least relative squares."""
    x = np.sqrt(depth / depth[-1])
    matrix = np.column_stack([x**i for i in range(1, min(degree, len(depth) - 1) + 1)])
    coefficients = np.linalg.lstsq(matrix / factor[:, None], (factor - at_touch) / factor, rcond=None)[0]
    curve: Floats = np.asarray(at_touch + matrix @ coefficients, float)
    return np.asarray(coefficients, float), curve, float(np.max(np.abs(curve / factor - 1.0)))


def _fit_table(facts: dict[str, Any], depth: Floats, factor: Floats, path: Path) -> ThicknessTable:
    """Return the polynomial of a file's rows; raises ValueError where they are not a smooth curve."""
    deepest = float(depth[-1])
    at_touch = facts.get("at_touch", 1.0)
    if isinstance(at_touch, bool) or not isinstance(at_touch, int | float) or not 0 < at_touch < math.inf:
        raise ValueError(f"table {path}: at_touch is the factor at no depth, a number above 0, not {at_touch!r}")
    coefficients, _, misfit = _curve(depth, factor, _DEGREE, at_touch)
    if not math.isfinite(misfit) or misfit > _MAX_MISFIT:
        raise ValueError(f"table {path}: the factors are not a smooth curve: a row is {misfit:.1%} off")
    return ThicknessTable(
        facts=facts, deepest=deepest, coefficients=tuple(coefficients.tolist()), worst=misfit, at_touch=at_touch
    )
