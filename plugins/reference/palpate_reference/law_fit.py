"""A fitted law, linear or hyperelastic, and what is printed and written of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from palpate import Floats
from palpate_engine import display_unit
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table

_SMALL = 0.05  # share of an uncertainty that is not printed
_CLOSE = 6.0  # BIC above the best
_REFUTED = 1e-3  # p


class LawDescription(Protocol):
    """What any law says of itself."""

    @property
    def name(self) -> str:
        """As it is chosen."""
        ...

    @property
    def formula(self) -> str:
        """In letters."""
        ...

    @property
    def parameters(self) -> tuple[tuple[str, str], ...]:
        """Names and SI units."""
        ...


Law = TypeVar("Law", bound=LawDescription)


@dataclass(frozen=True)
class TableFit(Generic[Law]):
    """A law at the values that describe tables best."""

    law: Law
    values: Floats  # (p,) [SI]
    stds: Floats  # (p,)
    covariance: Floats  # (p, p), of linear laws that of the logarithms of the values
    budget: Mapping[str, Floats]  # share of each source in stds (p,)
    scatter: tuple[float, ...]  # rms of the residuals of each table: relative, of stress over strain to its largest
    chi2: float  # of tables that state uncertainties
    freedom: int  # of those; 0 where none does
    bic: float
    autocorrelation: float  # of neighbouring residuals
    undetermined: tuple[str, ...]  # parameters that the tables do not determine

    @property
    def p(self) -> float:
        """Probability of so large a chi^2 if the law holds; NaN where no table states uncertainties."""
        from scipy.stats import chi2

        return float(chi2.sf(self.chi2, self.freedom)) if self.freedom > 0 else math.nan


AnyFit = TableFit[Any]


def supported_fits(fits: Sequence[TableFit[Law]]) -> list[TableFit[Law]]:
    """Laws whose BIC is within 6 of the best and that stated uncertainties do not refute; the best first."""
    standing = sorted((fit for fit in fits if not fit.p < _REFUTED), key=lambda fit: fit.bic)
    return [fit for fit in standing if fit.bic - standing[0].bic < _CLOSE]


def law_table(fits: Sequence[AnyFit]) -> Table:
    """Laws by evidence."""
    standing = supported_fits(fits)
    rows = [
        (
            fit.law.name, ", ".join(f"{100 * s:.2g}" for s in fit.scatter),
            f"{fit.chi2:.3g} / {fit.freedom}" if fit.freedom else "", f"{fit.bic - fits[0].bic:.3g}",
            "supported" if fit in standing else "",
        )
        for fit in fits
    ]  # fmt: skip
    return Table.of("laws", ("law", "residual\n%", "chi^2 / freedom", "BIC above\nthe best", ""), rows, ("law",))


def value_table(fit: AnyFit) -> Table:
    """Values of a law, each with its budget."""
    rows = []
    for k, (name, unit) in enumerate(fit.law.parameters):
        word, factor = display_unit(unit)
        text = value_with_uncertainty(factor * float(fit.values[k]), factor * float(fit.stds[k]))
        parts = [
            f"{abs(100 * share[k] / fit.values[k]):.2g} % {source if len(fit.scatter) > 1 else source.split(' of ')[0]}"
            for source, share in fit.budget.items()
            if share[k] > _SMALL * fit.stds[k]
        ]
        rows.append((name, text, "" if word == "1" else word, "; ".join(parts)))
    return Table.of(f"{fit.law.name}: {fit.law.formula}", ("parameter", "value", "unit", "from"), rows, ("parameter",))


def remarks(fits: Sequence[AnyFit]) -> list[str]:
    """What is to be doubted of the best law."""
    best, standing = fits[0], supported_fits(fits)
    doubts = []
    if best.undetermined:
        doubts.append(f"{best.law.name}: the tables do not determine {', '.join(best.undetermined)}")
    if not standing:
        doubts.append(f"no law describes the tables within their stated uncertainties (best: p = {best.p:.1g})")
    if len(standing) > 1:
        doubts.append(f"the tables do not choose between {' and '.join(fit.law.name for fit in standing)}")
    return doubts


def law_document(fit: AnyFit, supported: bool) -> dict[str, Any]:
    """Return a fitted law as plain data [SI]."""
    return {
        "law": fit.law.name, "formula": fit.law.formula, "supported": supported, "bic": fit.bic, "chi2": fit.chi2,
        "freedom": fit.freedom, "p": fit.p, "residual": fit.scatter, "autocorrelation": fit.autocorrelation,
        "undetermined": fit.undetermined,
        "parameters": {
            name: {
                "value": float(fit.values[k]), "std": float(fit.stds[k]), "unit": unit,
                "budget": {source: float(share[k]) for source, share in fit.budget.items()},
            }
            for k, (name, unit) in enumerate(fit.law.parameters)
        },
    }  # fmt: skip
