"""Display units at the edges, SI inside: ``"5 mm"`` becomes 0.005."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import PydanticCustomError, core_schema

if TYPE_CHECKING:
    import pint

_QUANTITY = re.compile(r"\s*([+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)\s*([A-Za-zµμΩ°%].*)?", re.DOTALL)
_SQUARE_ROOT = re.compile(r"sqrt\((\w+)\)")  # pint writes s^0.5

# One unit: names, multiplied and divided, each with one small exponent. pint would compute whatever it is given.
_NAME = r"\(*[A-Za-zµμΩ°%_][A-Za-z0-9µμΩ°%_]*(?:(?:\*\*|\^)\s*[+-]?\d(?:\.5)?)?\)*"
_UNIT = re.compile(rf"{_NAME}(?:(?:\s*[*/·]\s*|\s+){_NAME})*")
_LONGEST = 100  # characters of a quantity

_MILLI, _MICRO, _DEGREE = 1e-3, 1e-6, math.pi / 180


class _Unit(NamedTuple):
    """The name of an SI unit's dimension, and the display units that are usual for it."""

    dimension: str
    example: str
    written: Mapping[str, float] = {}  # SI units in one of each, by pint: these are read without its registry
    plausible: tuple[float, float] = (
        0.0,
        math.inf,
    )  # [SI] of a number without a unit, 0 aside
    meant: str = ""  # the unit that was perhaps meant by an implausible number


_UNITS = {
    "m": _Unit("length", "5 mm", {"m": 1.0, "mm": _MILLI, "cm": 1e-2, "um": _MICRO, "µm": _MICRO}, (0.0, 2.0), "mm"),
    "kg": _Unit("mass", "140 g", {"kg": 1.0, "g": _MILLI, "mg": _MICRO}, (0.0, 20.0), "g"),
    "s": _Unit(
        "time", "22 ms", {"s": 1.0, "ms": _MILLI, "us": _MICRO, "µs": _MICRO, "min": 60.0, "h": 3600.0}, meant="ms"
    ),
    "N": _Unit("force", "0.05 N", {"N": 1.0, "mN": _MILLI, "kN": 1e3}, (0.0, 2e3), "mN"),
    "Pa": _Unit("pressure", "112 kPa", {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6}, (500.0, 1e12), "kPa"),
    "Pa*s": _Unit("viscosity", "362 Pa*s", {"Pa*s": 1.0, "kPa*s": 1e3}),
    "Hz": _Unit("frequency", "500 Hz", {"Hz": 1.0, "kHz": 1e3}),
    "m/s": _Unit("speed", "4 mm/s", {"m/s": 1.0, "mm/s": _MILLI, "um/s": _MICRO, "cm/s": 1e-2}, (0.0, 2.0), "mm/s"),
    "m/s^2": _Unit("acceleration", "0.5 m/s^2", {"m/s^2": 1.0, "mm/s^2": _MILLI}, (0.0, 100.0), "mm/s^2"),
    "N*s/m": _Unit("damping", "10 N*s/m", {"N*s/m": 1.0}),
    "N/m": _Unit("stiffness", "100 N/mm", {"N/m": 1.0, "N/mm": 1e3}, (1.0, 1e9), "N/mm"),
    "N/s": _Unit("force drift", "1.5 N/h", {"N/s": 1.0, "N/h": 1 / 3600}),
    "N/s^0.5": _Unit("random walk of a force", "0.1 N/sqrt(h)"),
    "rad": _Unit("angle", "30 deg", {"rad": 1.0, "deg": _DEGREE}, (0.0, 6.3), "deg"),
    "rad/s": _Unit("angular speed", "10 deg/s", {"rad/s": 1.0, "deg/s": _DEGREE}, (0.0, 6.3), "deg/s"),
    "1": _Unit("pure number", "1.5"),
}


def _unit(unit: str) -> _Unit:
    return _UNITS.get(unit) or _Unit(f"quantity in {unit}", f"1 {unit}")


@cache
def _registry() -> pint.UnitRegistry[float]:
    import pint  # a third of a second: only those who give units pay for it

    return pint.UnitRegistry()


def dimension(unit: str) -> str:
    """The word for the dimension of an SI unit.

    >>> dimension("Pa*s")
    'viscosity'
    """
    return _unit(unit).dimension


def example(unit: str) -> str:
    """A quantity in the display unit, as an example in messages."""
    return _unit(unit).example


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

    Raises ValueError, with a readable message, on anything else or on another dimension.

    >>> to_si("5 mm", "m")
    0.005
    >>> to_si("5 kPa", "m")
    Traceback (most recent call last):
    ValueError: '5 kPa' is a pressure, not a length; write for example "5 mm"
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f'a {dimension(unit)} is wanted, a number in {unit} or a text such as "{example(unit)}"')
    try:
        number = float(value) if isinstance(value, int | float) else _parse(value, unit)
    except OverflowError:  # a whole number of 400 digits
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{_brief(value)} is not a finite {dimension(unit)}")
    return number


def _brief(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _parse(text: str, unit: str) -> float:
    wanted = f'write for example "{example(unit)}"'
    if len(text) > _LONGEST:
        raise ValueError(f"{_brief(text)} is too long for a {dimension(unit)}; {wanted}")
    match = _QUANTITY.fullmatch(text)
    if not match:
        raise ValueError(f"{text!r} is not a {dimension(unit)}; {wanted}")
    number, written = float(match[1]), (match[2] or "").strip()
    if not written and unit == "1":
        return number
    if not written:
        raise ValueError(f"{text!r} has no unit; {wanted}, or a plain number for {unit}")
    written = _SQUARE_ROOT.sub(r"\1^0.5", written)
    if not _UNIT.fullmatch(written):
        raise ValueError(f"{text!r}: {written!r} is not one unit; {wanted}")
    if (factor := _unit(unit).written.get(written)) is not None:
        return number * factor
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
    for unit, (name, *_) in _UNITS.items():
        if registry.Unit(unit).dimensionality == given.dimensionality:
            return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"
    return f"in {given}"


class Quantity:
    """Marks a float field as a physical quantity held in one SI unit, and readable from ``"5 mm"``.

    A number without a unit is doubted where it is beyond `most` [SI], or beyond what is plausible for the unit.
    """

    def __init__(self, unit: str, most: float | None = None) -> None:
        self.unit = unit
        self.most = most

    def doubt(self, number: float) -> str:
        """Why a number without a unit was hardly meant, with what may have been; empty where it may well be.

        >>> Quantity("m").doubt(4)
        '4 without a unit is 4 m; did you mean "4 mm"? (write "4 m" where it is meant)'
        """
        own = _unit(self.unit)
        least, most = own.plausible
        most = most if self.most is None else self.most
        size = abs(number)
        if size == 0 or least <= size <= most or not math.isfinite(size):
            return ""
        factor = own.written.get(own.meant, 0.0)
        meant = (
            f'; did you mean "{number:g} {own.meant}"?' if least <= size * factor <= most else ", which is implausible"
        )
        read = f"{number:g} {self.unit}"
        return f'{number:g} without a unit is {read}{meant} (write "{read}" where it is meant)'

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
        return quantity_schema(self.unit)


def quantity_schema(unit: str) -> JsonSchemaValue:
    """JSON schema of what `to_si` reads: a number, or a text with a unit that is not one of another dimension."""
    number = r"^\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*"
    others = "|".join(re.escape(text) for other, row in _UNITS.items() if other != unit for text in row.written)
    text = {
        "pattern": number + ("" if unit == "1" else "[A-Za-zµμΩ°%]"),
        "not": {"pattern": f"{number}({others})\\s*$"},
    }
    return {
        "anyOf": [{"type": "number"}, {"type": "string", **text}],
        "description": f'a {dimension(unit)}: "{example(unit)}", or a number in {unit}',
    }


Length = Annotated[float, Quantity("m")]
Depth = Annotated[float, Quantity("m", most=0.3)]  # of tips, specimens and palpations
Mass = Annotated[float, Quantity("kg")]
TipMass = Annotated[float, Quantity("kg", most=4.0)]
Time = Annotated[float, Quantity("s")]
Delay = Annotated[float, Quantity("s", most=2.0)]  # between signals
Force = Annotated[float, Quantity("N")]
ForceDrift = Annotated[float, Quantity("N/s")]
ForceWalk = Annotated[float, Quantity("N/s^0.5")]
Pressure = Annotated[float, Quantity("Pa")]
Viscosity = Annotated[float, Quantity("Pa*s")]
Damping = Annotated[float, Quantity("N*s/m")]
Stiffness = Annotated[float, Quantity("N/m")]
Frequency = Annotated[float, Quantity("Hz")]
Speed = Annotated[float, Quantity("m/s")]
Acceleration = Annotated[float, Quantity("m/s^2")]
Angle = Annotated[float, Quantity("rad")]
AngularSpeed = Annotated[float, Quantity("rad/s")]


# SI unit -> its display unit, and how many of it one SI unit is.
_PEOPLE = {"Pa": ("kPa", 1e-3), "m": ("mm", 1e3), "Pa*s": ("Pa s", 1.0)}


def display_unit(unit: str) -> tuple[str, float]:
    """The display unit for an SI unit, and how many of it one SI unit is.

    >>> display_unit("Pa")
    ('kPa', 0.001)
    """
    return _PEOPLE.get(unit, (unit, 1.0))
