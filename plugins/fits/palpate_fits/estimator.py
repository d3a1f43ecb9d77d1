"""The `casadi-fit` estimator: it refuses what contradicts, and starts a fit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from palpate import ConfigurationError, Problem, Tracker

from palpate_fits.budget import stated_sources
from palpate_fits.fit_settings import FitSettings
from palpate_fits.segments import parse_segment
from palpate_fits.unknowns import unknowns_of


class CasadiFit(FitSettings):
    """A least-squares fit of a contact model to a whole record, with the height of the surface unknown.

    Minimises the sum of w (F(d, d') + m d'' + bias + slope t - u)^2 over the model's parameters, the height z_surf
    of the surface, by which d = z_surf - z, and what else is named in `unknowns`, subject to
    |u(z_surf)| <= force_uncertainty (paper,
    eqs. ls and minprob). Jacobian and Hessian are exact, from the model's one expression. The standard deviation counts
    the residuals' autocorrelation and every declared systematic term; `fit` and `details` in result.json hold
    covariance, profile-likelihood intervals, budget, correlations, AIC and BIC.
    Assumes that the model is right: a flag says when the residuals contradict it.
    """

    def start(self, problem: Problem) -> Tracker:
        """Return a tracker that needs the whole record at once; raises ConfigurationError where the settings
        contradict."""
        from palpate_fits.tracker import FitTracker

        windows, unknown_names = parse_segment(self.segment), self.unknowns or ()
        for contradiction in self._contradictions(problem):
            raise ConfigurationError(f"estimator casadi-fit: {contradiction}")
        fixed: dict[str, Any] = dict(self.fixed)
        if "tip_mass" not in fixed and "tip_mass" not in unknown_names:
            fixed["tip_mass"] = problem.tip_mass or 0.0
        unknowns = unknowns_of(problem.model, unknown_names, fixed, self.start_at, self.bounds)
        free = [unknowns.names[place] for place in unknowns.free]
        for name in self.systematic:
            if name in free:
                problem_text = f"systematic: {name} is an unknown of the fit, which finds its uncertainty itself"
                raise ConfigurationError(f"estimator casadi-fit: {problem_text}")
        fixed_units = {item.name: item.unit for item in unknowns.items if not item.free}
        sources = stated_sources(problem.model, self.systematic, fixed_units)
        return FitTracker(settings=self, problem=problem, windows=windows, unknowns=unknowns, sources=sources)

    def _contradictions(self, problem: Problem) -> Iterator[str]:
        """Yield the settings that exclude one another, and what the problem lacks for them."""
        if self.contact_point != "free" and ("surface" in self.fixed or "surface" in self.bounds):
            yield f'contact_point = "{self.contact_point}" finds the surface, so it can be neither fixed nor bounded'
        if self.solver == "lm" and problem.model.memory:
            yield 'solver "lm" does not take models with memory; take "trf" or "auto"'
        if problem.tip_mass is None and "tip_mass" in self.systematic and "tip_mass" not in self.fixed:
            yield "systematic: tip_mass has an uncertainty but no value: set [alignment] tip_mass"
