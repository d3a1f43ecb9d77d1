"""The Prony series of a law, as programs of finite elements take it for a viscoelastic material."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from palpate import ConfigurationError

from palpate_reference.decade_series import DECADES

MATERIAL = "material.json"  # of `palpate material fit`
_ARMS = ("standard-linear-solid", *(f"generalised-maxwell-{count}" for count in (2, 3, 4)))
SERIES = ("maxwell", *_ARMS, "burgers", DECADES)
_MIN_SHARE = 1e-9  # of the instantaneous modulus, a choice: a smaller arm is rounding of the fit


@dataclass(frozen=True)
class PronySeries:
    """G(t) = G_inf + sum of G_k exp(-t/tau_k), with one Poisson's ratio for all times."""

    lasting: float  # G_inf [Pa]
    arms: tuple[tuple[float, float], ...]  # G_k [Pa], tau_k [s]
    poisson: float
    remarks: tuple[str, ...] = ()  # law, values and uncertainties, in words

    @property
    def instant(self) -> float:
        """G_0 = G_inf + sum of G_k [Pa]."""
        return self.lasting + sum(strength for strength, _ in self.arms)

    @property
    def bulk(self) -> float | None:
        """K_0 [Pa] of the instantaneous answer; None of an incompressible material."""
        if self.poisson >= 0.5:
            return None
        return 2.0 * self.instant * (1.0 + self.poisson) / (3.0 * (1.0 - 2.0 * self.poisson))

    @property
    def shares(self) -> list[tuple[float, float]]:
        """Pairs of G_k/G_0 and tau_k [s]."""
        return [(strength / self.instant, time) for strength, time in self.arms]


def series_of_law(table: Mapping[str, Any], poisson: float) -> PronySeries:
    """Return the series of a law of ``material.json``; raises ConfigurationError for one that has none."""
    if table["law"] not in SERIES:
        raise ConfigurationError(f"{table['law']} is not a Prony series; fit one: --law generalised-maxwell-3")
    values = [float(parameter["value"]) for parameter in table["parameters"].values()]
    lasting, arms = _young_series(table["law"], values, table.get("times") or (), poisson)
    # From Young's moduli to shear moduli; arms without strength are left out.
    factor = 2.0 * (1.0 + poisson)
    min_strength = _MIN_SHARE * (lasting + sum(strength for strength, _ in arms))
    return PronySeries(
        lasting / factor if lasting > min_strength else 0.0,
        tuple((strength / factor, time) for strength, time in arms if strength > min_strength),
        poisson,
        tuple(law_remarks(table, f"Young's moduli, Poisson's ratio {poisson:g}")),
    )


def _young_series(
    law: str, values: Sequence[float], times: Sequence[float], poisson: float
) -> tuple[float, list[tuple[float, float]]]:
    """Return E_inf [Pa], and pairs of E_k [Pa] and tau_k [s], from the values of a law; `times` [s] are of decades."""
    if law == DECADES:
        return values[0], list(zip(values[1:], times, strict=True))
    if law in _ARMS:
        return values[0], list(zip(values[1::2], values[2::2], strict=True))
    factor = 2.0 * (1.0 + poisson)  # from a viscosity in shear to that in tension
    if law == "maxwell":
        return 0.0, [(values[0], factor * values[1] / values[0])]
    return 0.0, _burgers_arms(E1=values[0], eta1=factor * values[1], E2=values[2], eta2=factor * values[3])


def _burgers_arms(E1: float, eta1: float, E2: float, eta2: float) -> list[tuple[float, float]]:
    """Return two pairs of a modulus [Pa] and a relaxation time [s] for Burgers' model.

    With p1 = eta1/E1 + eta1/E2 + eta2/E2, p2 = eta1 eta2/(E1 E2), A = sqrt(p1^2 - 4 p2) and the rates
    r1 = (p1 - A)/(2 p2) = 2/(p1 + A), r2 = (p1 + A)/(2 p2), the moduli are (q1 - q2 r1)/A and (q2 r2 - q1)/A with
    q1 = eta1 and q2 = eta1 eta2/E2. Source: Findley, Lai and Onaran 1976.
    """
    p1 = eta1 / E1 + eta1 / E2 + eta2 / E2
    p2 = eta1 * eta2 / (E1 * E2)
    A = math.sqrt(p1 * p1 - 4.0 * p2)
    r1, r2 = 2.0 / (p1 + A), (p1 + A) / (2.0 * p2)
    q1, q2 = eta1, eta2 * eta1 / E2
    return [((q1 - q2 * r1) / A, 1.0 / r1), ((q2 * r2 - q1) / A, 1.0 / r2)]


def law_remarks(table: Mapping[str, Any], assumption: str) -> list[str]:
    """Return the comments of a card: law and assumption, then values in SI with standard uncertainties (k = 1)."""
    remarks = [f"{table['law']}: {table['formula']}; {assumption}; k = 1"]
    for name, parameter in table["parameters"].items():
        unit = parameter["unit"]
        std = "not determined" if parameter["std"] is None else f"u = {parameter['std']:.3g} {unit}"
        remarks.append(f"{name} = {parameter['value']:.6g} {unit}, {std}")
    return remarks
