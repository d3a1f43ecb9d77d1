"""Suggestions for a name that an object does not have."""

from __future__ import annotations

from typing import Any, TypeVar

from palpate import suggest

T = TypeVar("T")
_SYNONYMS = {  # names of other programs, and those of palpate
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


def with_suggestions(cls: type[T]) -> type[T]:
    """Return a class whose AttributeError suggests a similar attribute, or a value that is reached by ["name"]."""
    class_name = cls.__name__

    def raise_with_suggestion(self: Any, name: str) -> Any:
        if name.startswith("_"):  # notebooks, copies and pickles look for such names
            raise AttributeError(f"{class_name!r} object has no attribute {name!r}")
        if hasattr(cls, name):  # a property that raised AttributeError itself: raise that error
            return object.__getattribute__(self, name)
        track = self.__dict__.get("track", self)
        parameters = getattr(track, "parameters", {}) if name != "parameters" else {}
        if name in parameters:
            raise AttributeError(f"{class_name} has no attribute {name!r}; it is the value [{name!r}]")
        attributes = [text for text in dir(self) if not (text.startswith("_") or hasattr(float, text))]
        if _SYNONYMS.get(name) in attributes:
            raise AttributeError(f"{class_name} has no attribute {name!r}; did you mean {_SYNONYMS[name]!r}?")
        raise AttributeError(f"{class_name} has no attribute {name!r}{suggest(name, attributes)}")

    cls.__getattr__ = raise_with_suggestion  # type: ignore[attr-defined]
    return cls
