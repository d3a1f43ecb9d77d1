"""Display units at the edges, SI inside: ``"5 mm"`` becomes 0.005."""

from __future__ import annotations

import math
import re
from difflib import get_close_matches
from typing import Annotated, Any, NamedTuple

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import PydanticCustomError, core_schema

from palpate.unit_symbols import Unit, UnknownUnitError, is_one_unit, read_unit, unit_names

_QUANTITY = re.compile(r"\s*([+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)\s*([A-Za-zµμΩ°%].*)?", re.DOTALL)
_MAX_LENGTH = 100  # characters, a choice: of a quantity
_MAX_SHOWN = 60  # characters, a choice: of a value in a message
_SLIP_SIMILARITY = 0.5  # a choice: a slip such as "mn" for "mm" shares half of its letters


class _Quantity(NamedTuple):
    """The name of an SI unit's dimension, and the units that are usual for it."""

    dimension: str
    example: str
    usual: tuple[str, ...] = ()
    plausible: tuple[float, float] = (0.0, math.inf)  # [SI], a choice: of a number without a unit, 0 aside
    meant: str = ""  # the likely unit of an implausible number


_QUANTITIES = {
    "m": _Quantity("length", "5 mm", ("m", "mm", "cm", "um", "µm"), (0.0, 2.0), "mm"),
    "kg": _Quantity("mass", "140 g", ("kg", "g", "mg"), (0.0, 20.0), "g"),
    "s": _Quantity("time", "22 ms", ("s", "ms", "us", "µs", "min", "h"), meant="ms"),
    "N": _Quantity("force", "0.05 N", ("N", "mN", "kN"), (0.0, 2e3), "mN"),
    "N*m": _Quantity("torque", "2 N*m", ("N*m", "N*mm", "mN*m"), (0.0, 200.0), "N*mm"),
    "Pa": _Quantity("pressure", "112 kPa", ("Pa", "kPa", "MPa"), (500.0, 1e12), "kPa"),
    "Pa*s": _Quantity("viscosity", "362 Pa*s", ("Pa*s", "kPa*s")),
    "Hz": _Quantity("frequency", "500 Hz", ("Hz", "kHz")),
    "m/s": _Quantity("speed", "4 mm/s", ("m/s", "mm/s", "um/s", "cm/s"), (0.0, 2.0), "mm/s"),
    "m/s^2": _Quantity("acceleration", "0.5 m/s^2", ("m/s^2", "mm/s^2"), (0.0, 100.0), "mm/s^2"),
    "N*s/m": _Quantity("damping", "10 N*s/m", ("N*s/m",)),
    "N/m": _Quantity("stiffness", "100 N/mm", ("N/m", "N/mm"), (1.0, 1e9), "N/mm"),
    "N*m/rad": _Quantity("rotational stiffness", "80 N*m/rad", ("N*m/rad",), (0.0, 1e4)),
    "kg*m^2": _Quantity("moment of inertia", "0.001 kg*m^2", ("kg*m^2",), (0.0, 10.0)),
    "N/s": _Quantity("force drift", "1.5 N/h", ("N/s", "N/h")),
    "N/s^0.5": _Quantity("random walk of a force", "0.1 N/sqrt(h)"),
    "rad": _Quantity("angle", "30 deg", ("rad", "deg"), (0.0, 6.3), "deg"),
    "rad/s": _Quantity("angular speed", "10 deg/s", ("rad/s", "deg/s"), (0.0, 6.3), "deg/s"),
    "1": _Quantity("pure number", "1.5"),
}


def _quantity(unit: str) -> _Quantity:
    """Return the quantity of an SI unit; of one that is not listed, named after the unit."""
    return _QUANTITIES.get(unit) or _Quantity(f"quantity in {unit}", f"1 {unit}")


def _si(unit: str) -> Unit:
    """Return an SI unit; "1" is that of a pure number."""
    return Unit(1.0, {}) if unit == "1" else read_unit(unit)


def dimension(unit: str) -> str:
    """Return the word for the dimension of an SI unit.

    >>> dimension("Pa*s")
    'viscosity'
    """
    return _quantity(unit).dimension


def example(unit: str) -> str:
    """Return a quantity in the display unit, as an example in messages."""
    return _quantity(unit).example


def is_number(text: str) -> bool:
    """Return True if a text is a number without a unit.

    >>> is_number("-1e3"), is_number("5 mm")
    (True, False)
    """
    try:
        float(text)
    except ValueError:
        return False
    return True


def is_unit(text: str) -> bool:
    """Return True if a text is a unit, or the sign of per cent.

    >>> is_unit("Pa s"), is_unit("%"), is_unit("correlation")
    (True, True, False)
    """
    try:
        return text == "%" or bool(is_one_unit(text) and read_unit(text))
    except UnknownUnitError:
        return False


def to_si(value: object, unit: str) -> float:
    """Return a number in SI from a person's statement: a number (SI already) or a text with a unit.

    Raises ValueError, with a readable message, on anything else or on another dimension.

    >>> to_si("5 mm", "m")
    0.005
    >>> to_si("5 kPa", "m")
    Traceback (most recent call last):
    ValueError: '5 kPa' is a pressure, not a length; write for example "5 mm"
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        quantity_name = _with_article(dimension(unit))
        raise ValueError(f'expected {quantity_name}: a number in {unit} or a text such as "{example(unit)}"')
    try:
        number = float(value) if isinstance(value, int | float) else _parse(value, unit)
    except OverflowError:  # a whole number of 400 digits
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{_brief(value)} is not a finite {dimension(unit)}")
    return number


def _brief(value: object) -> str:
    """Return a value as a message shows it, cut to `_MAX_SHOWN`."""
    text = repr(value)
    return text if len(text) <= _MAX_SHOWN else f"{text[: _MAX_SHOWN - 3]}..."


def _parse(text: str, unit: str) -> float:
    """Return the number of a text in an SI unit; raises ValueError with the form that is expected."""
    form = f'write for example "{example(unit)}"'
    if len(text) > _MAX_LENGTH:
        raise ValueError(f"{_brief(text)} is too long for {_with_article(dimension(unit))}; {form}")
    match = _QUANTITY.fullmatch(text)
    if not match:
        raise ValueError(f"{text!r} is not {_with_article(dimension(unit))}; {form}")
    # The pattern has two groups: the number, and what follows it.
    number, written = float(match[1]), (match[2] or "").strip()
    if not written and unit == "1":
        return number
    if not written:
        raise ValueError(f"{text!r} has no unit; {form}")
    if not is_one_unit(written):
        raise ValueError(f"{text!r}: {written!r} is not one unit; {form}")
    try:
        stated = read_unit(written)
    except UnknownUnitError as error:
        raise ValueError(f"{text!r}: unknown unit {written!r}{_meant(written, unit)}; {form}") from error
    si = _si(unit)
    if stated.dimensions != si.dimensions:
        expected = _with_article(dimension(unit))
        raise ValueError(f"{text!r} is {_dimension_of(stated, written)}, not {expected}; {form}")
    return number * (stated.factor / si.factor)


def _dimension_of(stated: Unit, written: str) -> str:
    """Return the dimension of a unit with its article, as "a force"; for an unnamed one "in" and the unit."""
    for unit, (name, *_) in _QUANTITIES.items():
        if _si(unit).dimensions == stated.dimensions:
            return _with_article(name)
    return f"in {written}"


def _with_article(name: str) -> str:
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"


def _meant(written: str, unit: str) -> str:
    """Return ``; did you mean "kPa"?`` for an unknown unit: one of the expected dimension if any resembles it."""
    expected, usual = _quantity(unit).usual, [text for row in _QUANTITIES.values() for text in row.usual]
    slips = [name for name in expected if len(name) == len(written) and name[0] == written[0]]  # "mn" for "mm"
    names = dict.fromkeys([*expected, *usual, *unit_names()])
    # The expected dimension before the others, and another case of letters before another spelling.
    close = (
        [name for name in expected if name.lower() == written.lower()]
        or get_close_matches(written, slips, n=1, cutoff=_SLIP_SIMILARITY)
        or [name for name in names if name.lower() == written.lower()]
        or get_close_matches(written, names, n=1)
    )
    return f'; did you mean "{close[0]}"?' if close else ""


class Quantity:
    """Marks a float field as a physical quantity held in one SI unit, and readable from ``"5 mm"``.

    A number without a unit is doubted where it is beyond `most` [SI], or beyond what is plausible for the unit.
    """

    def __init__(self, unit: str, most: float | None = None) -> None:
        self.unit = unit
        self.most = most

    def doubt(self, number: float) -> str:
        """Return why a number without a unit is implausible, with the likely one; empty if it is plausible.

        >>> Quantity("m").doubt(4)
        '4 without a unit is 4 m; did you mean "4 mm"? (write "4 m" where it is meant)'
        """
        quantity = _quantity(self.unit)
        lowest, highest = quantity.plausible
        highest = highest if self.most is None else self.most
        size = abs(number)
        if size == 0 or lowest <= size <= highest or not math.isfinite(size):
            return ""
        # The likely unit, where the number is plausible in that.
        factor = read_unit(quantity.meant).factor if quantity.meant else 0.0
        hint = ", which is implausible"
        if lowest <= size * factor <= highest:
            hint = f'; did you mean "{number:g} {quantity.meant}"?'
        in_si = f"{number:g} {self.unit}"
        return f'{number:g} without a unit is {in_si}{hint} (write "{in_si}" where it is meant)'

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
    """Return the JSON schema of `to_si`: a number, or a text with a unit that is not one of another dimension."""
    number = r"^\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*"
    foreign_units = []
    for other_unit, quantity in _QUANTITIES.items():
        if other_unit != unit:
            foreign_units += [re.escape(text) for text in quantity.usual]
    foreign_pattern = "|".join(foreign_units)
    text = {
        "pattern": number + ("" if unit == "1" else "[A-Za-zµμΩ°%]"),
        "not": {"pattern": f"{number}({foreign_pattern})\\s*$"},
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
Torque = Annotated[float, Quantity("N*m")]
ForceDrift = Annotated[float, Quantity("N/s")]
ForceWalk = Annotated[float, Quantity("N/s^0.5")]
Pressure = Annotated[float, Quantity("Pa")]
Viscosity = Annotated[float, Quantity("Pa*s")]
Damping = Annotated[float, Quantity("N*s/m")]
Stiffness = Annotated[float, Quantity("N/m")]
RotationalStiffness = Annotated[float, Quantity("N*m/rad")]
Inertia = Annotated[float, Quantity("kg*m^2")]
Frequency = Annotated[float, Quantity("Hz")]
Speed = Annotated[float, Quantity("m/s")]
Acceleration = Annotated[float, Quantity("m/s^2")]
Angle = Annotated[float, Quantity("rad")]
AngularSpeed = Annotated[float, Quantity("rad/s")]


# SI unit -> its display unit, and the number of display units in one SI unit.
_DISPLAY_UNITS = {"Pa": ("kPa", 1e-3), "m": ("mm", 1e3), "Pa*s": ("Pa s", 1.0)}


def display_unit(unit: str) -> tuple[str, float]:
    """Return the display unit for an SI unit, and the number of display units in one SI unit.

    >>> display_unit("Pa")
    ('kPa', 0.001)
    """
    return _DISPLAY_UNITS.get(unit, (unit, 1.0))
