"""The spectrum of times and the height of the skin that describe a press best."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from palpate import Floats

from palpate_spectra.first_touch import excess_distance
from palpate_spectra.transient.press_problem import PressProblem, PressUnknowns, SpectrumFit
from palpate_spectra.transient.recorded_press import RecordedPress

_SURFACE_REACH = 5e-4  # [m] around the touch, in which the skin is searched: a choice
_SURFACE_TOLERANCE = 1e-6  # [m] of that search: a choice
_INTERVAL_SIGMAS = 1.96  # of 95 % of a normal distribution; its square, 3.84, limits chi^2 of one degree of freedom


def solve_spectrum(problem: PressProblem, surface: float | None) -> tuple[SpectrumFit, PressUnknowns, float, Floats]:
    """Return the spectrum of a relaxation, its rig, the surface's standard uncertainty [m], and those of the bins (m,).

    The skin is at the stated `surface` [m], or where some spectrum describes the press. The rig is the height of the
    skin with the rig's compliance [m/N]; `target` (m,) [N] is the force of the bins, which the spectrum is to give.
    """
    press = problem.press
    compliance = float(press.rig["compliance"])
    rig = PressUnknowns(press.touch if surface is None else surface, compliance)
    _, target, _ = problem.linear_system(rig)
    stds = np.full(len(problem.bins.counts), problem.noise_std(target)) / np.sqrt(problem.bins.counts)
    surface_std = 0.0
    for _ in range(2):  # the second time with the noise that the residuals of the first show
        if surface is None:
            fitted_surface, surface_std = _fit_surface(problem, rig, stds)
            rig = PressUnknowns(fitted_surface, compliance)
        stds = problem.bin_stds(problem.solve(rig, stds))
    fit = problem.solve(rig, stds)
    if surface is None:
        # The misfit widens it; a delay moves the skin by the speed; the first touch may show it elsewhere.
        speed = float(np.max(np.abs(np.gradient(press.height, press.time))))
        delay_shift = (press.rig["timing"] or 0.0) * speed
        surface_std *= math.sqrt(max(fit.estimate.chi2 / fit.estimate.freedom, 1.0))
        surface_std = math.hypot(surface_std, delay_shift, excess_distance(press.first_touch, rig.surface))
    return fit, rig, surface_std, stds


def creep_spectrum(
    press: RecordedPress, load_std: float, rig: PressUnknowns
) -> tuple[PressProblem, SpectrumFit, Floats]:
    """Return a press as a creep, its spectrum, and the standard deviations (m,) of its bins.

    `load_std` is that of one reading of the load. The noise is the force's, and moves the area by the same share.
    """
    problem = PressProblem(press, creeps=True)
    rows = press.longest_hold.rows
    columns, target, _ = problem.linear_system(rig)
    load, area = columns[rows, 0], target[rows]
    area_std = load_std * float(area.mean() / load.mean())
    stds = np.maximum(area_std, problem.noise_std(target)) / np.sqrt(problem.bins.counts)
    return problem, problem.solve(rig, stds), stds


def _fit_surface(problem: PressProblem, rig: PressUnknowns, stds: Floats) -> tuple[float, float]:
    """Return the middle [m] of all surfaces with which some spectrum describes the press, and their standard deviation.

    A surface describes it where chi^2 is within 3.84 of the least, which is an interval of 95 %. Smoothness is not
    asked for: a smooth spectrum has fast parts that a material need not have, and moves the skin to fit them.
    """
    from scipy.optimize import brentq, minimize_scalar

    def chi2_of(surface: float) -> float:
        """Return the least chi^2 with a surface [m]."""
        return problem.min_chi2(PressUnknowns(surface, rig.compliance), stds)

    solve: Any = brentq  # its annotations want numpy's floats
    lowest, highest = rig.surface - _SURFACE_REACH, rig.surface + _SURFACE_REACH
    options = {"xatol": _SURFACE_TOLERANCE}
    minimum: Any = minimize_scalar(chi2_of, bounds=(lowest, highest), method="bounded", options=options)
    best = float(minimum.x)
    limit = float(minimum.fun) + _INTERVAL_SIGMAS**2

    def interval_end(outermost: float) -> float:
        """Return the surface [m] between the best and an outermost one at which chi^2 reaches its limit."""
        if not chi2_of(outermost) > limit:
            return outermost
        return float(solve(lambda surface: chi2_of(surface) - limit, best, outermost, xtol=_SURFACE_TOLERANCE))

    low, high = interval_end(lowest), interval_end(highest)
    return 0.5 * (low + high), 0.5 * (high - low) / _INTERVAL_SIGMAS
