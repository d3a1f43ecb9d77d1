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

_PRINTED_SHARE = 0.05  # of an uncertainty, a choice: a smaller contribution is not printed
_MAX_BIC_DIFFERENCE = 6.0  # above the best; strong evidence beyond (Kass and Raftery 1995)
_REFUTED = 1e-3  # p, a choice: one true law in a thousand is refuted by chance
MAX_CORRELATION = 0.9  # of neighbouring residuals, a choice: above it the inflation of a covariance is arbitrary


class LawDescription(Protocol):
    """Description of any law."""

    @property
    def name(self) -> str:
        """Name by which a law is chosen."""
        ...

    @property
    def formula(self) -> str:
        """Formula in letters."""
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
    """Return the laws whose BIC is within 6 of the best and that stated uncertainties do not refute; best first."""
    unrefuted = sorted((fit for fit in fits if not fit.p < _REFUTED), key=lambda fit: fit.bic)
    return [fit for fit in unrefuted if fit.bic - unrefuted[0].bic < _MAX_BIC_DIFFERENCE]


def law_table(fits: Sequence[AnyFit]) -> Table:
    """Return the laws side by side, with their evidence."""
    supported = supported_fits(fits)
    rows = []
    for fit in fits:
        scatter = ", ".join(f"{100 * table_scatter:.2g}" for table_scatter in fit.scatter)
        chi2 = f"{fit.chi2:.3g} / {fit.freedom}" if fit.freedom else ""
        rows.append(
            (fit.law.name, scatter, chi2, f"{fit.bic - fits[0].bic:.3g}", "supported" if fit in supported else "")
        )
    return Table.of("laws", ("law", "residual\n%", "chi^2 / freedom", "BIC above\nthe best", ""), rows, ("law",))


def value_table(fit: AnyFit) -> Table:
    """Return the values of a law, each with its budget; a single table is not named in it."""
    has_one_table = len(fit.scatter) == 1
    rows = []
    for k, (name, unit) in enumerate(fit.law.parameters):
        unit_name, factor = display_unit(unit)
        value = value_with_uncertainty(factor * float(fit.values[k]), factor * float(fit.stds[k]))
        parts = []
        for source, share in fit.budget.items():
            if share[k] > _PRINTED_SHARE * fit.stds[k]:
                source_name = source.split(" of ")[0] if has_one_table else source
                parts.append(f"{abs(100 * share[k] / fit.values[k]):.2g} % {source_name}")
        rows.append((name, value, "" if unit_name == "1" else unit_name, "; ".join(parts)))
    return Table.of(f"{fit.law.name}: {fit.law.formula}", ("parameter", "value", "unit", "from"), rows, ("parameter",))


def remarks(fits: Sequence[AnyFit]) -> list[str]:
    """Return sentences on what is doubtful of the best law."""
    best, supported = fits[0], supported_fits(fits)
    doubts = []
    if best.undetermined:
        doubts.append(f"{best.law.name}: the tables do not determine {', '.join(best.undetermined)}")
    if not supported:
        doubts.append(f"no law describes the tables within their stated uncertainties (best: p = {best.p:.1g})")
    if len(supported) > 1:
        doubts.append(f"the tables do not choose between {' and '.join(fit.law.name for fit in supported)}")
    return doubts


def law_document(fit: AnyFit, supported: bool) -> dict[str, Any]:
    """Return a fitted law as plain data [SI]."""
    parameters = {
        name: {
            "value": float(fit.values[k]),
            "std": float(fit.stds[k]),
            "unit": unit,
            "budget": {source: float(share[k]) for source, share in fit.budget.items()},
        }
        for k, (name, unit) in enumerate(fit.law.parameters)
    }
    return {
        "law": fit.law.name,
        "formula": fit.law.formula,
        "supported": supported,
        "bic": fit.bic,
        "chi2": fit.chi2,
        "freedom": fit.freedom,
        "p": fit.p,
        "residual": fit.scatter,
        "autocorrelation": fit.autocorrelation,
        "undetermined": fit.undetermined,
        "parameters": parameters,
    }
