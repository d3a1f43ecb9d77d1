"""A row of a folder of fits: one track's fit of one curve, with its groups and its mark."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from palpate_engine import needs_fact

from palpate_kit.curves.curve_fits import row_conditions
from palpate_kit.curves.curve_list import PLACES


@dataclass(frozen=True)
class CurveRow:
    """One track's fit of one curve, with the groups and the mark of the curve."""

    curve: str
    track: str
    cells: Mapping[str, str]  # of ``fits.csv``
    groups: Mapping[str, str]  # of ``curves.csv``
    rejected: str | None = None  # the reason; None for a curve that is not rejected
    accepted: bool = False
    current: bool = True  # fitted with the present settings

    def number(self, name: str) -> float | None:
        """Return a number of the row [SI]; None if it has none."""
        try:
            value = float(self.cells.get(name) or "nan")
        except ValueError:
            return None
        return value if math.isfinite(value) else None

    def usable_number(self, name: str) -> float | None:
        """Return a value of the row [SI] that may enter statistics; None without one, and for one that needs a fact."""
        return None if needs_fact(self.verdict_of(name)) else self.number(name)

    def systematic(self, name: str) -> float | None:
        """Return the uncertainty of a value [SI] that all curves of a rig share; None if unknown.

        It is what the combined uncertainty has in addition to that of the fit: sqrt(combined^2 - std^2).
        """
        std, combined = self.number(f"{name}_std"), self.number(f"{name}_combined")
        return None if std is None or combined is None else math.sqrt(max(combined**2 - std**2, 0.0))

    @property
    def verdict(self) -> str:
        """The verdict; invalid for a curve whose fit failed, "" for one without a fit."""
        return self.cells.get("verdict") or ("invalid" if self.error else "")

    @property
    def flags(self) -> tuple[str, ...]:
        """Codes of its flags."""
        return tuple((self.cells.get("flags") or "").split())

    @property
    def conditions(self) -> tuple[str, ...]:
        """The open facts on whose assumption its values depend."""
        return tuple(row_conditions(self.cells))

    def verdict_of(self, name: str) -> str:
        """Return the verdict of a value, such as "needs delay"; "" if it has none."""
        return self.cells.get(f"{name}_verdict") or ""

    @property
    def error(self) -> str:
        """The reason for which the fit failed; "" for one that did not."""
        return self.cells.get("error") or ""

    @property
    def usable(self) -> bool:
        """True if its values may enter statistics."""
        return self.rejected is None and self.verdict not in ("", "invalid")

    @property
    def mark(self) -> str:
        """bad, good or none."""
        return "bad" if self.rejected is not None else "good" if self.accepted else "none"

    @property
    def state(self) -> str:
        """current, stale after a change of the settings, or missing."""
        return "missing" if not self.cells else "current" if self.current else "stale"

    @property
    def place(self) -> tuple[float, float] | None:
        """x and y [m], as ``curves.csv`` states them, else as they were measured."""
        if all(self.groups.get(name) for name in PLACES):
            return stated_place(self.groups)
        x, y = self.number("x"), self.number("y")
        return None if x is None or y is None else (x, y)


def stated_place(cells: Mapping[str, str]) -> tuple[float, float] | None:
    """Return x and y [m] that the cells of a curve in ``curves.csv`` state; None unless both are finite numbers."""
    try:
        x, y = (float(cells.get(name) or "nan") for name in PLACES)
    except ValueError:
        return None
    return (x, y) if math.isfinite(x) and math.isfinite(y) else None
