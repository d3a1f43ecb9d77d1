"""Units as people write them: names, prefixes and their values in SI."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from functools import cache
from typing import NamedTuple

# One unit: names, multiplied and divided, each with one small exponent.
_NAME = r"[A-Za-zµμΩ°%_][A-Za-z0-9µμΩ°%_]*"
_POWER = r"(?:(?:\*\*|\^)\s*[+-]?\d(?:\.5)?)?"
_FACTOR = rf"\(*{_NAME}{_POWER}\)*"
_UNIT = re.compile(rf"{_FACTOR}(?:(?:\s*[*/·]\s*|\s+){_FACTOR})*")
_TOKEN = re.compile(rf"({_NAME})(?:\s*(?:\*\*|\^)\s*([+-]?\d(?:\.5)?))?|([/()])")
_SQUARE_ROOT = re.compile(r"sqrt\((\w+)\)")

# Prefixes and their powers of ten (BIPM).
_SYMBOLS = {"p": -12, "n": -9, "u": -6, "µ": -6, "μ": -6, "m": -3, "c": -2, "k": 3, "M": 6, "G": 9}
_WORDS = {"pico": -12, "nano": -9, "micro": -6, "milli": -3, "centi": -2, "kilo": 3, "mega": 6, "giga": 9}
_PI = math.pi.as_integer_ratio()  # a double is a ratio of whole numbers


class UnknownUnitError(ValueError):
    """A name that is not a unit."""


class Unit(NamedTuple):
    """The value of a unit in SI."""

    factor: float
    dimensions: Mapping[str, float]  # base unit -> its power, none of them 0


class _Base(NamedTuple):
    """A unit under one name."""

    numerator: int  # of its value in SI, a ratio of whole numbers
    denominator: int
    dimensions: Mapping[str, int]


_FORCE, _PRESSURE = {"kg": 1, "m": 1, "s": -2}, {"kg": 1, "m": -1, "s": -2}


def _prefixed_units() -> tuple[dict[str, _Base], dict[str, _Base]]:
    """Return the units that take prefixes, by their symbols and by their words: those of SI, bar and poise."""
    symbols, words_of_units = dict[str, _Base](), dict[str, _Base]()
    for symbol, spelled, dimensions in (
        ("m", ("meter", "metre"), {"m": 1}),
        ("g", ("gram",), {"kg": 1}),
        ("s", ("second", "sec"), {"s": 1}),
        ("N", ("newton",), _FORCE),
        ("Pa", ("pascal",), _PRESSURE),
        ("Hz", ("hertz",), {"s": -1}),
        ("rad", ("radian",), {"rad": 1}),
        ("J", ("joule",), {"kg": 1, "m": 2, "s": -2}),
        ("W", ("watt",), {"kg": 1, "m": 2, "s": -3}),
        ("A", ("ampere",), {"A": 1}),
        ("V", ("volt",), {"kg": 1, "m": 2, "s": -3, "A": -1}),
        ("Ω", ("ohm",), {"kg": 1, "m": 2, "s": -3, "A": -2}),
        ("K", ("kelvin",), {"K": 1}),
    ):
        base = _Base(1, 1000 if symbol == "g" else 1, dimensions)  # a gram is 1/1000 of the unit of SI
        symbols[symbol] = base
        words_of_units |= {name: base for singular in spelled for name in (singular, f"{singular}s")}
    # 1e5 Pa, and the poise of the CGS system, 0.1 Pa s.
    symbols["bar"] = _Base(100_000, 1, _PRESSURE)
    symbols["P"] = words_of_units["poise"] = _Base(1, 10, {"kg": 1, "m": -1, "s": -1})
    return symbols, words_of_units


def _fixed_units() -> dict[str, _Base]:
    """Return the units that take no prefix, by name."""
    units = dict[str, _Base]()
    # Standard gravity [1e-5 m/s^2] and the avoirdupois pound [1e-8 kg], both exact by definition, as is the inch of
    # 25.4 mm.
    gravity, pound = 980_665, 45_359_237
    for names, over, under, dimensions in (
        (("min", "minute", "minutes"), 60, 1, {"s": 1}),
        (("h", "hr", "hour", "hours"), 3600, 1, {"s": 1}),
        (("d", "day", "days"), 86_400, 1, {"s": 1}),
        (("deg", "degree", "degrees", "°"), _PI[0], 180 * _PI[1], {"rad": 1}),
        (("rpm",), 2 * _PI[0], 60 * _PI[1], {"rad": 1, "s": -1}),
        (("in", "inch", "inches"), 254, 10_000, {"m": 1}),
        (("ft", "foot", "feet"), 3048, 10_000, {"m": 1}),
        (("micron", "microns"), 1, 10**6, {"m": 1}),
        (("lb", "pound", "pounds"), pound, 10**8, {"kg": 1}),
        (("gf",), gravity, 10**8, _FORCE),
        (("kgf",), gravity, 10**5, _FORCE),
        (("lbf",), pound * gravity, 10**13, _FORCE),
        (("dyn", "dyne"), 1, 10**5, _FORCE),
        (("psi",), pound * gravity * 10_000**2, 10**13 * 254**2, _PRESSURE),
        (("%", "percent"), 1, 100, {}),
    ):
        units |= dict.fromkeys(names, _Base(over, under, dimensions))
    return units


_BY_SYMBOL, _BY_WORD = _prefixed_units()
_WITHOUT_PREFIX = _fixed_units()


def is_one_unit(written: str) -> bool:
    """Return True if a text has the form of a unit; its names may be unknown.

    >>> is_one_unit("N*s/mm"), is_one_unit("mm**9**9")
    (True, False)
    """
    return _UNIT.fullmatch(_SQUARE_ROOT.sub(r"\1^0.5", written)) is not None


@cache
def read_unit(written: str) -> Unit:
    """Return the unit of a text that has the form of one (`is_one_unit`).

    Raises UnknownUnitError for a name that is not a unit, and for brackets that do not match. Read from left to right:
    N/m*s is (N/m)*s. The factor is a ratio of whole numbers, rounded once, but for square roots.

    >>> read_unit("mm/min").factor, dict(read_unit("N/sqrt(h)").dimensions)
    (1.6666666666666667e-05, {'kg': 1.0, 'm': 1.0, 's': -2.5})
    """
    numerator, denominator, root = 1, 1, 1.0
    dimensions = dict[str, float]()
    for name, power in _named_powers(written):
        base = _base(name)
        over, under = base.numerator, base.denominator
        if power < 0:
            over, under = under, over
        # The factor to its whole power, and the root of half a power.
        whole, fraction = divmod(abs(power), 1.0)  # a fraction is 0.5: `_TOKEN` admits no other
        numerator *= over ** int(whole)
        denominator *= under ** int(whole)
        root *= math.sqrt(over / under) if fraction else 1.0
        for dimension, exponent in base.dimensions.items():
            dimensions[dimension] = dimensions.get(dimension, 0.0) + exponent * power
    powers = {dimension: total for dimension, total in dimensions.items() if total}
    return Unit(numerator / denominator * root, powers)


def _named_powers(written: str) -> Iterator[tuple[str, float]]:
    """Yield the names in a text such as "N/(m*s^2)", each with its power, which is negative under a stroke.

    Raises UnknownUnitError for brackets that do not match.
    """
    # The sign of the next exponent, and a stack of the signs that hold within each open bracket; outside it is 1.
    sign, open_signs = 1, [1]
    for name, exponent, mark in _TOKEN.findall(_SQUARE_ROOT.sub(r"\1^0.5", written)):
        if mark == "(":
            open_signs.append(sign * open_signs[-1])
        elif mark == ")" and len(open_signs) > 1:
            open_signs.pop()
        elif mark == ")":
            raise UnknownUnitError(written)
        if not mark:
            yield name, sign * open_signs[-1] * float(exponent or 1)
        # A stroke inverts the next name or bracket alone.
        sign = -1 if mark == "/" else 1
    if len(open_signs) > 1:
        raise UnknownUnitError(written)


def _base(name: str) -> _Base:
    """Return the unit of a name, with its prefix if it has one; raises UnknownUnitError."""
    for table in (_BY_SYMBOL, _BY_WORD, _WITHOUT_PREFIX):
        if name in table:
            return table[name]
    for prefixes, units in ((_SYMBOLS, _BY_SYMBOL), (_WORDS, _BY_WORD)):
        for prefix, exponent in prefixes.items():
            base = units.get(name.removeprefix(prefix)) if name.startswith(prefix) else None
            if base:
                up, down = (10**exponent, 1) if exponent > 0 else (1, 10**-exponent)
                return _Base(base.numerator * up, base.denominator * down, base.dimensions)
    raise UnknownUnitError(name)


def unit_names() -> list[str]:
    """Return every name without its prefix."""
    return [*_BY_SYMBOL, *_BY_WORD, *_WITHOUT_PREFIX]
