"""A value with its unit, its uncertainty, and what that is made of."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from palpate import ConfigurationError, to_si
from palpate.host import display_unit
from palpate_kit.terminal.quantities import value_with_uncertainty


@dataclass(frozen=True)
class UncertainQuantity:
    """A value and its standard uncertainties, in SI; printed in display units.

    >>> print(UncertainQuantity("elasticity", 112840.0, 160.0, 200.0, "Pa"))
    112.84 ± 0.20 kPa
    """

    name: str
    value: float
    std: float  # standard deviation, as the estimator gives it
    combined: float  # standard uncertainty of all parts together; NaN where it is not known
    unit: str
    budget: Mapping[str, float] = field(default_factory=dict)  # standard uncertainty by source
    caveat: str = ""  # what has to hold where it follows from other parameters

    @classmethod
    def of(cls, name: str, table: Mapping[str, Any], budget: Mapping[str, float] | None = None) -> UncertainQuantity:
        """From a value's table in ``result.json``."""
        value, std, combined = (math.nan if table.get(key) is None else table[key] for key in _NUMBERS)
        return cls(name, value, std, combined, table["unit"], dict(budget or {}), table.get("caveat", ""))

    def to(self, unit: str) -> float:
        """The value in another unit, such as ``to("MPa")``; raises ConfigurationError for another dimension."""
        try:
            return self.value / to_si(f"1 {unit}", self.unit)
        except ValueError as error:
            raise ConfigurationError(f"{self.name}: {error}") from error

    def __float__(self) -> float:
        return self.value

    def __str__(self) -> str:
        return f"{self.number} {display_unit(self.unit)[0]}".removesuffix(" 1")

    def __repr__(self) -> str:
        return str(self)

    @property
    def number(self) -> str:
        """The value and its combined uncertainty in display units, without that unit."""
        factor = display_unit(self.unit)[1]
        return value_with_uncertainty(self.value * factor, self.combined * factor)


_NUMBERS = ("value", "std", "combined")
