"""People's units at the edges, SI inside: ``"5 mm"`` becomes 0.005."""

from __future__ import annotations

import math
import re
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import PydanticCustomError, core_schema

if TYPE_CHECKING:
    import pint

_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([A-Za-zµμΩ°%].*)?", re.DOTALL)

# What the dimension of a unit is called when a message has to say so.
_NAMES = {
    "m": "length",
    "kg": "mass",
    "s": "time",
    "N": "force",
    "Pa": "pressure",
    "Pa*s": "viscosity",
    "Hz": "frequency",
    "m/s": "speed",
    "m/s^2": "acceleration",
    "N*s/m": "damping",
    "N/m": "stiffness",
    "N/s": "force drift",
    "rad": "angle",
    "1": "pure number",
}
_EXAMPLES = {
    "m": "5 mm",
    "kg": "140 g",
    "s": "22 ms",
    "N": "0.05 N",
    "Pa": "112 kPa",
    "Pa*s": "362 Pa*s",
    "Hz": "500 Hz",
    "m/s": "4 mm/s",
    "m/s^2": "0.5 m/s^2",
    "N*s/m": "10 N*s/m",
    "N/m": "100 N/mm",
    "N/s": "1.5 N/h",
    "rad": "30 deg",
    "1": "1.5",
}


@cache
def _registry() -> pint.UnitRegistry[float]:
    import pint  # a third of a second: only those who give units pay for it

    return pint.UnitRegistry()


def dimension(unit: str) -> str:
    """The word for the dimension of an SI unit.

    >>> dimension("Pa*s")
    'viscosity'
    """
    return _NAMES.get(unit, f"quantity in {unit}")


def example(unit: str) -> str:
    """A quantity that a person would write for an SI unit, for messages."""
    return _EXAMPLES.get(unit, f"1 {unit}")


def is_number(text: str) -> bool:
    """Whether a text is a number as it stands, without a unit.

    >>> is_number("-1e3"), is_number("5 mm")
    (True, False)
    """
    try:
        float(text)
    except ValueError:
        return False
    return True


def to_si(value: object, unit: str) -> float:
    """A number in SI from what a person wrote: a number (SI already) or a text with a unit.

    Raises ValueError, with a message for people, on anything else or on another dimension.

    >>> to_si("5 mm", "m")
    0.005
    >>> to_si("5 kPa", "m")
    Traceback (most recent call last):
    ValueError: '5 kPa' is a pressure, not a length; write for example "5 mm"
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f'a {dimension(unit)} is wanted, a number in {unit} or a text such as "{example(unit)}"')
    number = float(value) if isinstance(value, int | float) else _parse(value, unit)
    if not math.isfinite(number):
        raise ValueError(f"{value!r} is not a finite {dimension(unit)}")
    return number


def _parse(text: str, unit: str) -> float:
    match = _QUANTITY.fullmatch(text)
    wanted = f'write for example "{example(unit)}"'
    if not match:
        raise ValueError(f"{text!r} is not a {dimension(unit)}; {wanted}")
    number, written = float(match[1]), (match[2] or "").strip()
    if not written and unit == "1":
        return number
    if not written:
        raise ValueError(f"{text!r} has no unit; {wanted}, or a plain number for {unit}")
    registry = _registry()
    try:
        given = registry.Unit(written)
    except Exception as error:  # pint raises a dozen kinds, tokenizer errors among them
        raise ValueError(f"{text!r}: unknown unit {written!r}; {wanted}") from error
    if given.dimensionality != registry.Unit(unit).dimensionality:
        raise ValueError(f"{text!r} is {_dimension_of(given)}, not a {dimension(unit)}; {wanted}")
    return float(registry.Quantity(number, given).to(unit).magnitude)


def _dimension_of(given: pint.Unit) -> str:
    registry = _registry()
    for unit, name in _NAMES.items():
        if registry.Unit(unit).dimensionality == given.dimensionality:
            return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"
    return f"in {given}"


class Quantity:
    """Marks a float field as a physical quantity held in one SI unit, and readable from ``"5 mm"``."""

    def __init__(self, unit: str) -> None:
        self.unit = unit

    def _validate(self, value: Any) -> float:
        try:
            return to_si(value, self.unit)
        except ValueError as error:
            raise PydanticCustomError("quantity", "{reason}", {"reason": str(error)}) from error

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_before_validator_function(self._validate, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        return {
            "anyOf": [{"type": "number"}, {"type": "string"}],
            "description": f'a {dimension(self.unit)}: "{example(self.unit)}", or a number in {self.unit}',
        }


Length = Annotated[float, Quantity("m")]
Mass = Annotated[float, Quantity("kg")]
Time = Annotated[float, Quantity("s")]
Force = Annotated[float, Quantity("N")]
ForceDrift = Annotated[float, Quantity("N/s")]
Pressure = Annotated[float, Quantity("Pa")]
Viscosity = Annotated[float, Quantity("Pa*s")]
Damping = Annotated[float, Quantity("N*s/m")]
Stiffness = Annotated[float, Quantity("N/m")]
Frequency = Annotated[float, Quantity("Hz")]
Speed = Annotated[float, Quantity("m/s")]
Acceleration = Annotated[float, Quantity("m/s^2")]
Angle = Annotated[float, Quantity("rad")]


# SI unit -> what people write, and how many of it one SI unit is.
_PEOPLE = {"Pa": ("kPa", 1e-3), "m": ("mm", 1e3), "Pa*s": ("Pa s", 1.0)}


def people(unit: str) -> tuple[str, float]:
    """The unit that people write for an SI unit, and how many of it one SI unit is.

    >>> people("Pa")
    ('kPa', 0.001)
    """
    return _PEOPLE.get(unit, (unit, 1.0))
