"""Elementary functions that run on floats, arrays, complex numbers and CasADi symbols alike."""

from __future__ import annotations

from typing import Any

import numpy as np


def _is_symbolic(value: Any) -> bool:
    return type(value).__module__.startswith("casadi")


def _apply(name: str, symbolic_name: str, value: Any) -> Any:
    """Return a function of numpy, or of CasADi for one of its symbols, at a value."""
    if _is_symbolic(value):
        import casadi

        return getattr(casadi, symbolic_name)(value)
    return getattr(np, name)(value)


def log(value: Any) -> Any:
    """Return the natural logarithm."""
    return _apply("log", "log", value)


def sqrt(value: Any) -> Any:
    """Return the square root."""
    return _apply("sqrt", "sqrt", value)


def tanh(value: Any) -> Any:
    """Return the hyperbolic tangent."""
    return _apply("tanh", "tanh", value)


def arctan(value: Any) -> Any:
    """Return the inverse tangent [rad]."""
    return _apply("arctan", "atan", value)


def select(left: Any, above: float, inside: Any, otherwise: Any) -> Any:
    """Return `inside` where left > above, else `otherwise`; complex numbers are compared by their real part.

    Both are evaluated: guard their arguments where one of them has a pole on the other's side, or a derivative will
    not be finite there.
    """
    if _is_symbolic(left):
        import casadi

        return casadi.if_else(left > above, inside, otherwise)
    if _is_symbolic(inside) or _is_symbolic(otherwise):
        return inside if left > above else otherwise
    selection = np.where(np.real(left) > above, inside, otherwise)
    return selection if selection.ndim else selection[()]
