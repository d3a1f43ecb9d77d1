"""Elementary functions that run on floats, arrays, complex numbers and CasADi symbols alike."""

from __future__ import annotations

from typing import Any

import numpy as np


def _symbolic(value: Any) -> bool:
    return type(value).__module__.startswith("casadi")


def _of(name: str, symbolic_name: str, value: Any) -> Any:
    if _symbolic(value):
        import casadi

        return getattr(casadi, symbolic_name)(value)
    return getattr(np, name)(value)


def log(value: Any) -> Any:
    """Natural logarithm."""
    return _of("log", "log", value)


def sqrt(value: Any) -> Any:
    """Square root."""
    return _of("sqrt", "sqrt", value)


def tanh(value: Any) -> Any:
    """Hyperbolic tangent."""
    return _of("tanh", "tanh", value)


def arctan(value: Any) -> Any:
    """Inverse tangent [rad]."""
    return _of("arctan", "atan", value)


def select(left: Any, above: float, inside: Any, otherwise: Any) -> Any:
    """`inside` where left > above, else `otherwise`; complex numbers are compared by their real part.

    Both are evaluated: guard their arguments where one of them has a pole on the other's side, or a derivative will
    not be finite there.
    """
    if _symbolic(left):
        import casadi

        return casadi.if_else(left > above, inside, otherwise)
    if _symbolic(inside) or _symbolic(otherwise):
        return inside if left > above else otherwise
    chosen = np.where(np.real(left) > above, inside, otherwise)
    return chosen if chosen.ndim else chosen[()]
