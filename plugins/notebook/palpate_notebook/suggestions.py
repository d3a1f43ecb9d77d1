"""What was meant by a name that an object does not have."""

from __future__ import annotations

from typing import Any, TypeVar

from palpate import suggest

T = TypeVar("T")
_MEANT = {  # by names of other programs
    "E": "elasticity",
    "modulus": "elasticity",
    "youngs_modulus": "elasticity",
    "eta": "viscosity",
    "u": "combined",
    "uncertainty": "combined",
    "sigma": "std",
    "std_dev": "std",
    "magnitude": "value",
    "nominal_value": "value",
}


def with_suggestions(kind: type[T]) -> type[T]:
    """Return a class whose AttributeError names what is alike: its own names, and the values that are reached by
    ["name"]."""
    own = kind.__name__

    def absent(self: Any, name: str) -> Any:
        if name.startswith("_"):  # what notebooks, copies and pickles ask for
            raise AttributeError(f"{own!r} object has no attribute {name!r}")
        if hasattr(kind, name):  # it has it, and finding it failed
            return object.__getattribute__(self, name)
        values = self.__dict__.get("track", self)
        parameters = getattr(values, "parameters", {}) if name != "parameters" else {}
        if name in parameters:
            raise AttributeError(f"{own} has no attribute {name!r}; it is the value [{name!r}]")
        names = [text for text in dir(self) if not (text.startswith("_") or hasattr(float, text))]
        if _MEANT.get(name) in names:
            raise AttributeError(f"{own} has no attribute {name!r}; did you mean {_MEANT[name]!r}?")
        raise AttributeError(f"{own} has no attribute {name!r}{suggest(name, names)}")

    kind.__getattr__ = absent  # type: ignore[attr-defined]
    return kind
