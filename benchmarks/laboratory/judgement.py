"""What a result says of a palpation with a mistake, and what its record could have shown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from palpate import Floats

from laboratory.kinds import Mistake
from laboratory.motion import RATE
from laboratory.palpation import Palpation
from laboratory.sensing import Log, make_log

RIGHT = 0.02  # of a value
SHOWN = 3.0  # standard deviations
OUTCOMES = ("right", "covered", "reported", "silent", "false alarm")
MASS = 0.14  # [kg] as declared


def outcome(track: Mapping[str, Any], truth: tuple[float, float]) -> str:
    """What a track's result is, by its values, their combined uncertainties and its verdict.

    right: within 2 %, without doubt. covered: further off, but within two stated uncertainties. reported: doubtful or
    invalid. silent: beyond both, without doubt. false alarm: doubtful, and both values within 2 %.
    """
    found = [track["parameters"][name] for name in ("elasticity", "viscosity")]
    doubt = track["verdict"] in ("doubtful", "invalid")
    if any(one["value"] is None or one["combined"] is None for one in found):
        return "reported" if doubt else "silent"
    errors = [abs(one["value"] - true) for one, true in zip(found, truth, strict=True)]
    if doubt:
        good = all(e <= RIGHT * true for e, true in zip(errors, truth, strict=True))
        return "false alarm" if good else "reported"
    if all(e <= RIGHT * true for e, true in zip(errors, truth, strict=True)):
        return "right"
    spreads = [one["combined"] for one in found]
    within = all(e <= max(2 * u, RIGHT * t) for e, u, t in zip(errors, spreads, truth, strict=True))
    return "covered" if within else "silent"


def shown(mistake: Mistake) -> float:
    """Standard deviations by which the record differs from the best that the declared model makes of it.

    The square root of twice the logarithm of the likelihood ratio of the truth to the declared model, fitted to the
    whole record: force against contact and inertia, velocity against the slope of the height. Without end where the
    height has no noise.
    """
    p = mistake.palpation()
    if p.commanded is not None:
        return float("inf")
    log = make_log(p, 0, noise=False)
    if p.motion_unit != 1.0:
        return float("inf")  # no such machine
    same, first = np.diff(log.stamp, prepend=-1.0) > 0, log.stamp < 0.9
    log = Log(*(column[same] for column in (log.stamp, log.force, log.height, log.velocity, log.measuring)))
    force = log.force - log.force[first[same]].mean()
    slope = np.gradient(log.height, log.stamp)
    inertia = MASS * -np.gradient(log.velocity, log.stamp)
    even = _even(log.stamp)
    left = _best_left((force - inertia)[even], log.height[even], log.velocity[even], p)
    by_rate = ((log.velocity - slope) / p.velocity_noise)[even]
    return float(np.sqrt(left + by_rate @ by_rate))


def _even(stamp: Floats) -> Any:
    """Rows whose neighbours are one step away: a slope over a gap does not count."""
    step = np.diff(stamp)
    near = np.abs(step - 1.0 / RATE) < 0.3 / RATE
    return np.concatenate([[False], near[1:] & near[:-1], [False]])


def _best_left(force: Floats, height: Floats, velocity: Floats, p: Palpation) -> float:
    """Chi square of what a Kelvin-Voigt half-space under the declared sphere leaves at its best height of surface."""
    from scipy.optimize import minimize_scalar

    clean = replace(Palpation(), force_noise=p.force_noise)

    def columns(surface: float) -> Floats:
        depth = np.maximum(surface - height, 0.0)
        root = np.sqrt(clean.radius)
        return np.column_stack([16 / 9 * root * depth**1.5, -8 * root * np.sqrt(depth) * velocity])

    def cost(surface: float) -> float:
        a = columns(surface)
        unit = np.array([clean.elasticity, clean.viscosity])
        weights = np.linalg.lstsq(a * unit, force, rcond=None)[0] * unit
        depth = np.maximum(surface - height, 0.0)
        stiffness = 8 / 3 * clean.elasticity * np.sqrt(clean.radius * depth)
        damping = 8 * clean.viscosity * np.sqrt(clean.radius * depth)
        variance = (
            (p.force_unit * p.force_noise) ** 2
            + (stiffness * p.position_noise) ** 2
            + (damping * p.velocity_noise) ** 2
        )
        return float(np.sum((force - a @ weights) ** 2 / variance))

    span = np.linspace(-3e-3, 3e-3, 61)
    best = span[int(np.argmin([cost(x) for x in span]))]
    found: Any = minimize_scalar(cost, bounds=(best - 1e-4, best + 1e-4), method="bounded", options={"xatol": 1e-8})
    return float(found.fun)
