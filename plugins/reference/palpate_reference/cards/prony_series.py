"""The Prony series of a law: what programs of finite elements take for a viscoelastic material."""

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
_NONE = 1e-9  # share of the instantaneous modulus that is nothing


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
        """G_k/G_0 and tau_k."""
        return [(strength / self.instant, time) for strength, time in self.arms]


def series_of_law(table: Mapping[str, Any], poisson: float) -> PronySeries:
    """Return the series of a law of ``material.json``; raises ConfigurationError for one that has none."""
    if table["law"] not in SERIES:
        raise ConfigurationError(f"{table['law']} is not a Prony series; fit one: --law generalised-maxwell-3")
    parameters = {name: float(one["value"]) for name, one in table["parameters"].items()}
    lasting, arms = _young_series(table["law"], list(parameters.values()), table.get("times") or (), poisson)
    per = 2.0 * (1.0 + poisson)
    whole = lasting + sum(strength for strength, _ in arms)
    real = tuple((strength / per, time) for strength, time in arms if strength > _NONE * whole)
    about = f"Young's moduli, Poisson's ratio {poisson:g}"
    return PronySeries(
        lasting / per if lasting > _NONE * whole else 0.0, real, poisson, tuple(law_remarks(table, about))
    )


def _young_series(
    law: str, values: Sequence[float], times: Sequence[float], poisson: float
) -> tuple[float, list[tuple[float, float]]]:
    """E and E_k, tau_k; those of Burgers' model by Findley, Lai and Onaran 1976."""
    per = 2.0 * (1.0 + poisson)
    if law == DECADES:
        return values[0], list(zip(values[1:], times, strict=True))
    if law in _ARMS:
        return values[0], list(zip(values[1::2], values[2::2], strict=True))
    if law == "maxwell":
        return 0.0, [(values[0], per * values[1] / values[0])]
    instant, flow, delayed, delaying = values[0], per * values[1], values[2], per * values[3]
    p, product = flow / instant + flow / delayed + delaying / delayed, flow * delaying / (instant * delayed)
    root = math.sqrt(p * p - 4.0 * product)
    rates = 2.0 / (p + root), (p + root) / (2.0 * product)
    slow = (flow - delaying * flow / delayed * rates[0]) / root
    fast = (delaying * flow / delayed * rates[1] - flow) / root
    return 0.0, [(slow, 1.0 / rates[0]), (fast, 1.0 / rates[1])]


def law_remarks(table: Mapping[str, Any], about: str) -> list[str]:
    """What the comments of a card say: in SI, standard uncertainties with k = 1."""
    found = [f"{table['law']}: {table['formula']}; {about}; k = 1"]
    for name, one in table["parameters"].items():
        std = "not determined" if one["std"] is None else f"u = {one['std']:.3g} {one['unit']}"
        found.append(f"{name} = {one['value']:.6g} {one['unit']}, {std}")
    return found
