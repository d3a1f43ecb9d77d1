"""Formulas of the paper on its own numbers: + - * / ** and names, nothing else."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from decimal import Decimal

from palpate import ConfigurationError

from reproduction.item import half_digit

_OPERATORS: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}


def value_of(formula: str, given: Mapping[str, float]) -> float:
    """The value of a formula; raises ConfigurationError for anything else."""
    try:
        return _value(ast.parse(formula, mode="eval").body, given)
    except (SyntaxError, KeyError, TypeError, ZeroDivisionError, OverflowError) as error:
        raise ConfigurationError(f"formula {formula!r}: {error}") from error


def rounding(formula: str, given: Mapping[str, Decimal]) -> float:
    """Standard uncertainty of a formula's value by the digits of the numbers that are given."""
    numbers = {name: float(number) for name, number in given.items()}
    value = value_of(formula, numbers)
    changes = [
        value_of(formula, numbers | {name: numbers[name] + half_digit(number)}) - value
        for name, number in given.items()
    ]
    return math.hypot(*changes) / math.sqrt(3.0)


def _value(node: ast.expr, given: Mapping[str, float]) -> float:
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        return _OPERATORS[type(node.op)](_value(node.left, given), _value(node.right, given))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return -_value(node.operand, given)
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    if isinstance(node, ast.Name):
        return given[node.id]
    raise TypeError(f"{ast.unparse(node)} is not a number, name or operation")
