"""Values with their uncertainty, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from palpate.contact import ContactModel
from palpate.fit_report import Effect
from palpate.vectors import Floats


@dataclass(frozen=True)
class Bias:
    """What an estimate is expected to be off by."""

    shift: float  # [SI] value less truth
    std: float | None  # [SI] standard uncertainty of the shift; None: too little is known of it to correct the value
    shared: bool = False  # by whatever is estimated from the same samples, least squares too, as a delay is


@dataclass(frozen=True)
class UncertainValue:
    """A value with its uncertainty [SI]."""

    value: float
    std: float  # standard deviation, as the estimator believes it
    unit: str
    settling: float = 0.0  # standard uncertainty from an estimate that has not come to rest
    systematic: float | None = None  # standard uncertainty from timing, mass and tare; None where none is known
    budget: Mapping[str, float] = field(default_factory=dict)  # its terms by name
    per_shear: float | None = None  # [s] shift of timing that would explain the value: eta/G
    unknown: bool = False  # its uncertainty cannot be determined
    bias: Bias | None = None  # known, and with all of its shift in the combined uncertainty
    places: Mapping[str, float] = field(default_factory=dict)  # of a sweep: how many, and how they differ
    last: Mapping[str, float] = field(default_factory=dict)  # of a sweep: value and std at its end
    left: Mapping[str, float] = field(default_factory=dict)  # terms that are others for the corrected value
    verdict: str | None = None  # None until it has been judged

    @property
    def combined(self) -> float:
        """Standard uncertainty of all parts together; NaN where it cannot be determined."""
        if self.unknown:
            return math.nan
        return math.hypot(self.std, self.settling, self.systematic or 0.0)

    @property
    def of_one_place(self) -> float:
        """Combined uncertainty without how the places of a sweep differ, which is not an error."""
        return self.without("places")

    def without(self, *causes: str) -> float:
        """Combined standard uncertainty of all parts but those of some causes, which may be unknown."""
        others = [share for cause, share in self.budget.items() if cause not in (*causes, "places")]
        own = [size for cause, size in (("estimator", self.std), ("settling", self.settling)) if cause not in causes]
        return math.hypot(*own, *others)

    @property
    def corrected(self) -> UncertainValue | None:
        """The value less its known bias, with what is not known of that in place of all of it (GUM 3.2.4)."""
        if self.bias is None or self.bias.std is None:
            return None
        budget = {**self.budget, **self.left}
        value, systematic = self.value - self.bias.shift, math.hypot(*budget.values())
        return replace(self, value=value, systematic=systematic, budget=budget, left={}, bias=None)

    def table(self) -> dict[str, Any]:
        """As in ``result.json``; what is not a finite number becomes null."""
        known: dict[str, Any] = {"value": self.value, "std": self.std, "unit": self.unit, "settling": self.settling}
        if self.systematic is not None:
            known["systematic"] = self.systematic
        known["combined"] = self.combined
        known |= {f"systematic_{term}": share for term, share in self.budget.items()}
        if self.per_shear is not None:
            known["equivalent_delay"] = self.per_shear
        if self.bias is not None:
            known |= {"bias": self.bias.shift, "bias_std": finite(self.bias.std)}
            corrected = self.corrected
            known |= {"corrected": corrected.value, "corrected_combined": corrected.combined} if corrected else {}
        if self.verdict is not None:
            known["verdict"] = self.verdict
        along = {key: table for key, table in (("places", self.places), ("last", self.last)) if table}
        return {**{key: finite(entry) for key, entry in known.items()}, **finite_tree(along)}

    def effect(self, contribution: float, sensitivity: float | None = None) -> Effect:
        """What a source does to the value by a standard uncertainty [SI]."""
        return Effect.of(self.value, contribution, sensitivity)

    def diagnosed(
        self, cause: str, share: float, unknown: bool = False, bias: Bias | None = None, left: float | None = None
    ) -> UncertainValue:
        """With one more cause of systematic uncertainty [SI], one that cannot be determined, or a known bias.

        `left` [SI] is the share for the corrected value, where it is another one.
        """
        if share <= 0 and not unknown and bias is None and left is None:
            return self
        others = dict(self.left) | ({} if left is None else {cause: left})
        if bias is not None:
            others = {cause: math.hypot(share, bias.std or 0.0)}
            share = math.hypot(share, bias.shift)
        budget = dict(self.budget) | ({cause: share} if share > 0 else {})
        systematic = math.hypot(*budget.values()) if budget else None
        unknown, bias = self.unknown or unknown, bias or self.bias
        return replace(self, systematic=systematic, budget=budget, left=others, unknown=unknown, bias=bias)


@dataclass(frozen=True)
class DerivedValue:
    """Elasticity or viscosity that follows from a model's parameters, which are something else [SI]."""

    name: str
    found: UncertainValue
    caveat: str  # what has to hold for it to be a property of the material

    def table(self) -> dict[str, Any]:
        """As in ``result.json``."""
        return self.found.table() | {"caveat": self.caveat}


def derived_values(
    model: ContactModel, parameters: Mapping[str, UncertainValue], covariance: Floats | None = None
) -> tuple[DerivedValue, ...]:
    """What the parameters found say of the material, with their scatter and settling carried over.

    Scatter by the `covariance` (k, k) where the estimator reports it, else as uncorrelated. A value that is a parameter
    itself is not repeated.
    """
    found = [parameters[parameter.name] for parameter in model.parameters]
    return tuple(
        DerivedValue(
            value.name,
            UncertainValue(
                value.value,
                _scatter(np.array(value.gradient), [f.std for f in found], covariance),
                value.unit,
                value.std([f.settling for f in found]),
            ),
            value.caveat,
        )
        for value in model.material([f.value for f in found])
        if value.name not in parameters
    )


def _scatter(gradient: Floats, std: Sequence[float], covariance: Floats | None) -> float:
    """Standard deviation of a value with this gradient (k,); what `std` holds beyond the covariance is uncorrelated."""
    if covariance is None:
        return math.hypot(*(gradient * np.array(std)))
    rest = np.maximum(np.array(std) ** 2 - np.diag(covariance), 0.0)
    return float(np.sqrt(max(float(gradient @ covariance @ gradient), 0.0) + float(gradient**2 @ rest)))


def finite(value: Any) -> Any:
    """A number as JSON can hold it: null where it is not finite."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def finite_tree(value: Any) -> Any:
    """Plain data as JSON can hold it, with null for every number that is not finite."""
    if hasattr(value, "tolist"):  # of numpy
        return finite_tree(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): finite_tree(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [finite_tree(inner) for inner in value]
    return finite(value)
