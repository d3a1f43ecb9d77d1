"""A formula f(r) in a pipeline file, read by a whitelist of operations; never run as Python."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

_MAX_LENGTH = 500  # characters, a choice against formulas that nobody writes
_MAX_NESTING = 50  # operations, a choice: well within Python's own limit of recursion


def _smallest(*values: Any) -> Any:
    minimum = values[0]
    for value in values[1:]:
        minimum = np.where(np.real(value) < np.real(minimum), value, minimum)
    return minimum


def _largest(*values: Any) -> Any:
    return -_smallest(*(-value for value in values))


_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "sqrt": np.sqrt,
    "exp": np.exp,
    "log": np.log,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "abs": lambda value: np.where(np.real(value) < 0, -value, value),
    "min": _smallest,
    "max": _largest,
}
_OPERATORS: Mapping[type[ast.AST], Callable[..., Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
    ast.UAdd: np.positive,
    ast.USub: np.negative,
}


def parse_formula(text: str, constants: Mapping[str, float]) -> Callable[[Any], Any]:
    """Return the function f(r) of a text, for real and complex arrays.

    Allowed are numbers, r, pi, the given constants, + - * / ** (or ^) and brackets, and the functions sqrt, exp, log,
    sin, cos, tan, asin, acos, atan, sinh, cosh, tanh, abs, min, max. Raises ValueError for anything else.
    """
    if len(text) > _MAX_LENGTH:
        raise ValueError(f"the formula has {len(text)} characters; {_MAX_LENGTH} are allowed")
    try:
        tree = ast.parse(text.replace("^", "**").strip(), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
        raise ValueError(f"{text!r} is not a formula: {getattr(error, 'msg', error)}") from error
    names = {"pi": math.pi, **constants}
    _check(tree, text, {"r", *names}, 0)
    return lambda radius: _value(tree, {**names, "r": radius})


def _check(node: ast.AST, text: str, names: set[str], depth: int) -> None:
    """Raise ValueError where a part of a formula is not allowed.

    `node` is the part's syntax tree, `text` the whole formula, `names` those that it may use, `depth` the nesting.
    """
    if depth > _MAX_NESTING:
        raise ValueError(f"{text!r} is nested too deeply")
    match node:
        case ast.Constant(value=int() | float()) if not isinstance(node.value, bool):
            parts: list[ast.AST] = []
        case ast.Name(id=name) if name in names:
            parts = []
        case ast.Name(id=name):
            raise ValueError(f"{text!r}: {name!r} is unknown; there are {', '.join(sorted(names))} (add to constants)")
        case ast.BinOp(left, operator, right) if type(operator) in _OPERATORS:
            parts = [left, right]
        case ast.UnaryOp(operator, operand) if type(operator) in _OPERATORS:
            parts = [operand]
        case ast.Call(ast.Name(id=name), arguments, []) if name in _FUNCTIONS and len(arguments) > 0:
            if len(arguments) != 1 and name not in ("min", "max"):
                raise ValueError(f"{text!r}: {name} takes one argument")
            parts = list(arguments)
        case _:
            written = ast.unparse(node)
            raise ValueError(f"{text!r}: {written!r} is not allowed; there are {', '.join(_FUNCTIONS)} and + - * / **")
    for part in parts:
        _check(part, text, names, depth + 1)


def _value(node: ast.AST, names: Mapping[str, Any]) -> Any:
    """Return the value of a part of a formula that `_check` has passed."""
    match node:
        case ast.Constant(value):
            try:
                return float(value)  # type: ignore[arg-type]
            except OverflowError:
                return math.inf
        case ast.Name(name):
            return names[name]
        case ast.BinOp(left, operator, right):
            return _OPERATORS[type(operator)](_value(left, names), _value(right, names))
        case ast.UnaryOp(operator, operand):
            return _OPERATORS[type(operator)](_value(operand, names))
        case ast.Call(ast.Name(name), arguments):
            return _FUNCTIONS[name](*(_value(argument, names) for argument in arguments))
    raise AssertionError(ast.dump(node))  # _check refuses all others
