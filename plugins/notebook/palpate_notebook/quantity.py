"""A value with its unit, its uncertainty, and the budget of the uncertainty."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING, Any

from palpate import ConfigurationError, to_si
from palpate_engine import display_unit
from palpate_kit.terminal.quantities import FIXED, is_fixed, value_with_uncertainty

from palpate_notebook.html_table import html_table
from palpate_notebook.optional_imports import library
from palpate_notebook.suggestions import with_suggestions

if TYPE_CHECKING:
    import pint
    import uncertainties

_FORMAT = re.compile(
    r"(?P<pad>(?:.?[<>^])?)(?P<sign>[+ -]?)(?P<width>\d*)(?P<group>[,_]?)(?P<digits>(?:\.\d+)?[eEfFgG])"
)


@with_suggestions
@dataclass(frozen=True, eq=False, repr=False)
class UncertainQuantity(float):
    """A value and its standard uncertainties, in SI; printed in display units.

    Wherever a number is expected it is its value in SI; arithmetic gives plain numbers, without uncertainty.

    >>> elasticity = UncertainQuantity("elasticity", 112840.0, 160.0, 200.0, "Pa")
    >>> print(elasticity)
    112.84 ± 0.20 kPa
    >>> print(f"{elasticity:.1f}"), elasticity / 1e3, elasticity > 1e5
    112.8 ± 0.2 kPa
    (None, 112.84, True)
    """

    name: str
    value: float
    std: float  # standard deviation by the estimator
    combined: float  # combined standard uncertainty; NaN where it is not known
    unit: str
    budget: Mapping[str, float] = field(default_factory=dict)  # standard uncertainty by source
    caveat: str = ""  # condition under which it follows from other parameters
    verdict: str = ""  # good, doubtful, not determined, invalid, or needs and the missing fact

    def __new__(cls, name: str, value: float, *_: object, **__: object) -> UncertainQuantity:
        """Return a number with the value."""
        return super().__new__(cls, value)

    @classmethod
    def of(cls, name: str, table: Mapping[str, Any], budget: Mapping[str, float] | None = None) -> UncertainQuantity:
        """Return the quantity of a value's table in ``result.json``."""

        def number(key: str) -> float:
            return math.nan if table.get(key) is None else table[key]

        return cls(
            name,
            number("value"),
            std=number("std"),
            combined=number("combined"),
            unit=table["unit"],
            budget=dict(budget or {}),
            caveat=table.get("caveat", ""),
            verdict=table.get("verdict", ""),
        )

    def to(self, unit: str) -> float:
        """Return the value in another unit, such as ``to("MPa")``; raises ConfigurationError for another dimension."""
        try:
            return self.value / to_si(f"1 {unit}", self.unit)
        except ValueError as error:
            raise ConfigurationError(f"{self.name}: {error}") from error

    def to_uncertainties(self) -> uncertainties.UFloat:
        """Return value and combined uncertainty [SI] as a number of `uncertainties`, independent of all others.

        Raises UserError where that library is not installed.
        """
        return library("uncertainties").ufloat(self.value, self.combined, self.name)

    def to_pint(self, units: pint.UnitRegistry[Any] | None = None) -> pint.Quantity[Any]:
        """Return value and combined uncertainty as a quantity of `pint`, in a registry or the application's one.

        Raises UserError where `pint` or `uncertainties` is not installed.
        """
        unit_registry = units if units is not None else library("pint").get_application_registry()
        unit = "" if self.unit == "1" else self.unit
        quantity: pint.Quantity[Any] = unit_registry.Quantity(self.to_uncertainties(), unit)  # pyright: ignore[reportAssignmentType]
        return quantity

    @property
    def number(self) -> str:
        """The value and its combined uncertainty in display units, without the unit."""
        factor = display_unit(self.unit)[1]
        return value_with_uncertainty(self.value * factor, self.combined * factor)

    def __getnewargs__(self) -> tuple[str, float]:  # type: ignore[override]
        return self.name, self.value

    def __format__(self, spec: str) -> str:
        """Return both numbers by a numeric specification such as ".1f", in display units; else the text by `spec`."""
        match = _FORMAT.fullmatch(spec)
        if match is None:
            return format(str(self), spec)
        unit, factor = display_unit(self.unit)
        number_spec = match["group"] + match["digits"]
        value = format(self.value * factor, match["sign"] + number_spec)
        uncertainty = "?" if math.isnan(self.combined) else format(self.combined * factor, number_spec)
        # Fill and width apply to the whole text, right-aligned like a number.
        return format(f"{value} ± {uncertainty} {unit}".removesuffix(" 1"), (match["pad"] or ">") + match["width"])

    def __str__(self) -> str:
        text = f"{self.number} {display_unit(self.unit)[0]}".removesuffix(" 1")
        return f"{text}{FIXED}" if is_fixed(float(self), self.combined) else text

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        """Return name and value as HTML, with the table of the contributions to the uncertainty, largest first."""
        unit, factor = display_unit(self.unit)
        contributions = sorted(self.budget.items(), key=lambda item: -abs(item[1]))
        rows = [[source, f"{abs(contribution) * factor:.2g}"] for source, contribution in contributions]
        table = html_table(["source of uncertainty", f"u [{unit}]"], rows) if rows else ""
        caveat = f"<br>{escape(self.caveat)}" if self.caveat else ""
        return f"<b>{escape(self.name)}</b> {escape(str(self))}{caveat}{table}"
