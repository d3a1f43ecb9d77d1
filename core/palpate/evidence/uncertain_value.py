"""Values with their uncertainty, and values derived from them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from palpate.contact import ContactModel, MaterialValue
from palpate.fit_report import Effect
from palpate.vectors import Floats


@dataclass(frozen=True)
class Bias:
    """The expected error of an estimate."""

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
        """The standard uncertainty of all parts together; NaN where it cannot be determined."""
        if self.unknown:
            return math.nan
        return math.hypot(self.std, self.settling, self.systematic or 0.0)

    @property
    def of_one_place(self) -> float:
        """The combined uncertainty without the differences between the places of a sweep, which are not errors."""
        return self.without("places")

    def without(self, *causes: str) -> float:
        """Return the combined standard uncertainty of all parts but those of some causes, which may be unknown."""
        parts = [size for cause, size in (("estimator", self.std), ("settling", self.settling)) if cause not in causes]
        parts += [share for cause, share in self.budget.items() if cause not in (*causes, "places")]
        return math.hypot(*parts)

    @property
    def corrected(self) -> UncertainValue | None:
        """The value less its bias, with the bias's uncertainty in place of all of it (GUM 3.2.4).

        None without a bias whose uncertainty is known.
        """
        if self.bias is None or self.bias.std is None:
            return None
        budget = {**self.budget, **self.left}
        value, systematic = self.value - self.bias.shift, math.hypot(*budget.values())
        return replace(self, value=value, systematic=systematic, budget=budget, left={}, bias=None)

    def table(self) -> dict[str, Any]:
        """Return the value as in ``result.json``; null for every number that is not finite."""
        table: dict[str, Any] = {"value": self.value, "std": self.std, "unit": self.unit, "settling": self.settling}
        if self.systematic is not None:
            table["systematic"] = self.systematic
        table["combined"] = self.combined
        table |= {f"systematic_{term}": share for term, share in self.budget.items()}
        if self.per_shear is not None:
            table["equivalent_delay"] = self.per_shear
        if self.bias is not None:
            table |= {"bias": self.bias.shift, "bias_std": finite(self.bias.std)}
            corrected = self.corrected
            if corrected is not None:
                table |= {"corrected": corrected.value, "corrected_combined": corrected.combined}
        if self.verdict is not None:
            table["verdict"] = self.verdict
        sweep = {key: numbers for key, numbers in (("places", self.places), ("last", self.last)) if numbers}
        return {**{key: finite(entry) for key, entry in table.items()}, **finite_tree(sweep)}

    def effect(self, contribution: float, sensitivity: float | None = None) -> Effect:
        """Return the effect on the value of a source that contributes a standard uncertainty [SI]."""
        return Effect.of(self.value, contribution, sensitivity)

    def diagnosed(
        self, cause: str, share: float, unknown: bool = False, bias: Bias | None = None, left: float | None = None
    ) -> UncertainValue:
        """Return the value with one more cause of systematic uncertainty in its budget.

        `share` [SI] is the standard uncertainty by the cause; with `unknown` it is not known how large that is. A
        `bias` is what the cause shifts the value by. `left` [SI] is the share of the value corrected by its bias, where
        that is another one.
        """
        if share <= 0 and not unknown and bias is None and left is None:
            return self
        # Terms that the corrected value has in place of the others; a bias leaves its own uncertainty.
        corrected_terms = dict(self.left)
        if left is not None:
            corrected_terms[cause] = left
        if bias is not None:
            corrected_terms = {cause: math.hypot(share, bias.std or 0.0)}
            share = math.hypot(share, bias.shift)
        # The budget with this cause, and its root sum of squares.
        budget = dict(self.budget)
        if share > 0:
            budget[cause] = share
        systematic = math.hypot(*budget.values()) if budget else None
        unknown, bias = self.unknown or unknown, bias or self.bias
        return replace(self, systematic=systematic, budget=budget, left=corrected_terms, unknown=unknown, bias=bias)


@dataclass(frozen=True)
class DerivedValue:
    """Elasticity or viscosity that follows from a model's parameters, which are something else [SI]."""

    name: str
    found: UncertainValue
    caveat: str  # what has to hold for it to be a property of the material

    def table(self) -> dict[str, Any]:
        """Return the value as in ``result.json``."""
        return self.found.table() | {"caveat": self.caveat}


def derived_values(
    model: ContactModel, parameters: Mapping[str, UncertainValue], covariance: Floats | None = None
) -> tuple[DerivedValue, ...]:
    """Return the values of the material that follow from the parameters, with their standard uncertainties.

    `std` is propagated by the `covariance` (k, k) where the estimator reports it, else as of uncorrelated parameters;
    `settling`, the uncertainty by estimates that have not come to rest, as of uncorrelated ones. A value that is a
    parameter itself is not repeated.
    """
    estimates = [parameters[parameter.name] for parameter in model.parameters]
    stds = [estimate.std for estimate in estimates]
    settlings = [estimate.settling for estimate in estimates]
    derived = []
    for material in _material_values(model, [estimate.value for estimate in estimates]):
        if material.name in parameters:
            continue
        std = _propagated_std(np.array(material.gradient), stds, covariance)
        uncertain = UncertainValue(material.value, std, material.unit, settling=material.std(settlings))
        derived.append(DerivedValue(material.name, uncertain, material.caveat))
    return tuple(derived)


def _material_values(model: ContactModel, theta: Sequence[float]) -> Sequence[MaterialValue]:
    """Return what a model says of its material; raises ValueError for a gradient of another length than its values."""
    values = model.material(theta)
    for value in values:
        if len(value.gradient) != len(theta):
            lengths = f"{len(value.gradient)} numbers for {len(theta)} parameters"
            raise ValueError(f"material: the gradient of {value.name} has {lengths}")
    return values


def _propagated_std(gradient: Floats, stds: Sequence[float], covariance: Floats | None) -> float:
    """Return the standard deviation of a value by its gradient (k,), from those of the parameters (k,).

    The part of a parameter's variance that exceeds the covariance's diagonal is uncorrelated.
    """
    if covariance is None:
        return math.hypot(*(gradient * np.array(stds)))
    uncorrelated = np.maximum(np.array(stds) ** 2 - np.diag(covariance), 0.0)
    correlated = max(float(gradient @ covariance @ gradient), 0.0)
    return float(np.sqrt(correlated + float(gradient**2 @ uncorrelated)))


def finite(value: Any) -> Any:
    """Return a number for JSON: null where it is not finite."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def finite_tree(value: Any) -> Any:
    """Return plain data for JSON, with null for every number that is not finite."""
    if hasattr(value, "tolist"):  # of numpy
        return finite_tree(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): finite_tree(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [finite_tree(inner) for inner in value]
    return finite(value)
