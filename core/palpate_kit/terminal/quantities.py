"""Numbers as people read them."""

from __future__ import annotations

import math

from palpate_engine import display_unit

_LARGE_POWER, _SMALL_POWER = 6, -4  # of ten, from and below which a number is written with its power: a choice
_MAX_STD_RATIO = 1e3  # of an uncertainty to its value; beyond, both are written with their own powers: a choice
FIXED = " (fixed)"
_ROUNDING = 1e-12  # of a value, below which an uncertainty is one of rounding


def value_with_uncertainty(value: float, std: float) -> str:
    """Return a value and its uncertainty, to two digits of the uncertainty; one below rounding is left out.

    >>> value_with_uncertainty(126.5312, 0.2134), value_with_uncertainty(0.3, 1.1e-17)
    ('126.53 ± 0.21', '0.3')
    >>> value_with_uncertainty(-191151.2, 33757.3), value_with_uncertainty(6659825.0, 3417885.0)
    ('-191000 ± 34000', '(6.7 ± 3.4)e6')
    >>> value_with_uncertainty(-629471.0, 4.926e17), value_with_uncertainty(5.0013e-6, 1.2e-8)
    ('-6.3e+05 ± 4.9e+17', '(5.001 ± 0.012)e-6')
    """
    if not math.isfinite(value):
        return "-"
    if math.isnan(std):  # it is not known
        return f"{unsigned(f'{value:.4g}')} ± ?"
    if not (math.isfinite(std) and std > _ROUNDING * abs(value)):
        return unsigned(f"{value:.4g}")
    power = math.floor(math.log10(max(abs(value), std)))
    if std > _MAX_STD_RATIO * abs(value) and power >= _LARGE_POWER:
        return f"{unsigned(f'{value:.2g}')} ± {std:.2g}"
    if power >= _LARGE_POWER or power < _SMALL_POWER:
        return f"({_plain_text(value / 10.0**power, std / 10.0**power)})e{power}"
    return _plain_text(value, std)


def value_or_fixed(value: float, std: float) -> str:
    """Return a value and its uncertainty; one that was fixed without any says so.

    >>> value_or_fixed(126.5312, 0.2134), value_or_fixed(0.0, 0.0)
    ('126.53 ± 0.21', '0 (fixed)')
    """
    return f"{value_with_uncertainty(value, std)}{FIXED if is_fixed(value, std) else ''}"


def is_fixed(value: float, std: float | None) -> bool:
    """Return True for a value without any uncertainty, as only one that was fixed has."""
    return std == 0.0 and math.isfinite(value)


def _plain_text(value: float, std: float) -> str:
    """Return both to two digits of the uncertainty, but whole below a thousand."""
    digits = 1 - math.floor(math.log10(std))
    if digits < -1:
        value, std = round(value, digits), round(std, digits)
    places = max(0, digits)
    return f"{unsigned(f'{value:.{places}f}')} ± {std:.{places}f}"


def round_number(value: float) -> str:
    """Return a number to five digits; a nought without a sign.

    >>> round_number(-0.0), round_number(112503.2)
    ('0', '1.125e+05')
    """
    return unsigned(f"{value:.5g}")


def value_with_unit(value: float, std: float, unit: str) -> str:
    """Return a value and its uncertainty [SI] in the unit in which they are shown.

    >>> value_with_unit(112836.1, 1772.7, "Pa")
    '112.8 ± 1.8 kPa'
    """
    symbol, factor = display_unit(unit)
    return f"{value_with_uncertainty(value * factor, std * factor)} {symbol}".removesuffix(" 1")


def number_with_unit(value: float, unit: str, digits: int = 3) -> str:
    """Return a number [SI] in the unit in which it is shown.

    >>> number_with_unit(1772.66, "Pa"), number_with_unit(280.0, "Pa*s", 2)
    ('1.77 kPa', '2.8e+02 Pa s')
    """
    symbol, factor = display_unit(unit)
    return f"{value * factor:.{digits}g} {symbol}".removesuffix(" 1")


def unsigned(number: str) -> str:
    """Return a number's text; a nought without the sign that rounding has left.

    >>> unsigned("-0.00")
    '0.00'
    """
    return number.lstrip("-") if float(number) == 0 else number
