"""Numbers as people read them."""

from __future__ import annotations

import math

_ROUNDING = 1e-12  # of a value; less is no uncertainty


def value_with_uncertainty(value: float, std: float) -> str:
    """A value and its uncertainty, to two digits of the uncertainty; one that is below rounding is none.

    >>> value_with_uncertainty(126.5312, 0.2134), value_with_uncertainty(0.3, 1.1e-17)
    ('126.53 ± 0.21', '0.3')
    """
    if not math.isfinite(value):
        return "-"
    if math.isnan(std):  # it is not known
        return f"{unsigned(f'{value:.4g}')} ± ?"
    if not (math.isfinite(std) and std > _ROUNDING * abs(value)):
        return unsigned(f"{value:.4g}")
    digits = max(0, 1 - math.floor(math.log10(std)))
    return f"{unsigned(f'{value:.{digits}f}')} ± {std:.{digits}f}"


def round_number(value: float) -> str:
    """A number to five digits; a nought without a sign.

    >>> round_number(-0.0), round_number(112503.2)
    ('0', '1.125e+05')
    """
    return unsigned(f"{value:.5g}")


def unsigned(number: str) -> str:
    """A number's text; a nought without the sign that rounding has left.

    >>> unsigned("-0.00")
    '0.00'
    """
    return number.lstrip("-") if float(number) == 0 else number
