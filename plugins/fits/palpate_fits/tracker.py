"""A fit at work: from the record to estimates, once."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, cached_property, partial

import numpy as np
from palpate import Estimates, Flag, Floats, LastDigit, Problem, Samples
from palpate_kit.budget.uncertainty_sources import UncertaintySource
from palpate_kit.numerics.contact_point import Approach
from palpate_kit.numerics.force_limit import at_limit
from palpate_kit.numerics.refusal import NotFitted
from palpate_kit.numerics.tip_travel import (
    TipTravel,
    cubic_window,
    longest_window,
    median,
    smooth_height,
    zero_phase_motion,
)

from palpate_fits.approach import SurfaceByForce, constrained_surface
from palpate_fits.arm_order import in_order
from palpate_fits.contact_start import begins_in_contact, touching_from_start
from palpate_fits.first_guess import first_guess, guess_by_contrast, linear_places, moduli_of
from palpate_fits.fit_outcome import FitOutcome
from palpate_fits.fit_settings import FitSettings
from palpate_fits.height_noise import correct_attenuation
from palpate_fits.loss import LossFunction
from palpate_fits.multistart import (
    rivals,
    solve_from_each,
    solve_from_many,
    solve_or_try_others,
    times_of,
    with_times_that_show,
)
from palpate_fits.one_speed import with_possible_viscosity
from palpate_fits.record_arrays import FitRecord, make_record
from palpate_fits.residual import Residual
from palpate_fits.segments import RecordCourse, Rows, Window, passage, segment_rows
from palpate_fits.solvers import Solution, solve_lm, solve_trf
from palpate_fits.uncertainty import scatter
from palpate_fits.unknowns import Unknowns, at_physical_bounds

_AIR_SHARE = 0.1  # of the samples, from which on they determine the bias
_FEWEST = 5  # samples for each unknown
_THIN = 1000
_NO_GAIN = 1e-9  # of the cost: with 10 000 samples a hundredth of a standard deviation from the minimum
_SQUARES = LossFunction()


class FitTracker:
    """Fits the whole record that `run` is given; every run starts from nothing."""

    def __init__(
        self,
        settings: FitSettings,
        problem: Problem,
        windows: tuple[Window, ...],
        unknowns: Unknowns,
        sources: tuple[UncertaintySource, ...],
    ) -> None:
        self._settings, self._problem, self._windows = settings, problem, windows
        self._unknowns, self._sources = unknowns, sources
        self._residuals: dict[tuple[int, ...], Residual] = {}
        self._linear: dict[tuple[int, ...], tuple[int, ...]] = {}  # by what is free, which alone it follows from

    def run(self, samples: Samples) -> Estimates:
        """Estimates for the whole record; constant over the fitted samples, and idle outside them."""
        from palpate_fits.report import estimates_of

        if not len(samples):
            return Estimates.idle(samples, len(self._problem.model.parameters))
        known = np.isfinite(samples.position)
        if not known.all():
            return _spread(self.run(samples[known]), samples, known)
        try:
            return estimates_of(self.fit(samples))
        except NotFitted as refusal:
            idle = Estimates.idle(samples, len(self._problem.model.parameters))
            return replace(idle, flags=(refusal.flag,))

    def fit(self, samples: Samples) -> FitOutcome:
        """Return the fit of a record; raises NotFitted where it cannot be done."""
        settings, notes = self._settings, list[Flag]()
        begins_in_contact = cache(partial(self._begins_in_contact, samples))
        is_without_air = self._problem.force_zero != "air" and begins_in_contact()
        if is_without_air:
            samples = touching_from_start(samples)
        course = passage(samples)
        motion = zero_phase_motion(samples, settings.smoothing, self._longest_window(samples, course.travel))
        rows = segment_rows(self._windows, samples, motion.rate, course)
        rows = _without_saturation(samples, rows, notes)
        by_force = SurfaceByForce(samples, course, settings.threshold)
        unknowns = self._prepared(samples, rows, by_force, notes)
        if is_without_air:  # a viscosity below none would be a higher surface, see `one_speed_intervals`
            unknowns = at_physical_bounds(unknowns, self._problem.model)
        enough = max(_FEWEST * len(unknowns.free), 10)
        if np.count_nonzero(rows) < enough:
            raise NotFitted("too-few-samples", f"{np.count_nonzero(rows)} samples to fit; {enough} are needed")
        record = self._record(samples, rows, motion, course)
        model = self._problem.model
        if model.memory:
            unknowns = with_times_that_show(unknowns, record)
        linear = self._linear_places(unknowns)
        loss = LossFunction(settings.loss, settings.loss_scale)
        residual = self._residual(unknowns.free)
        x, minima = self._start(unknowns, record, loss)
        if len(record) > 2 * _THIN and not model.memory:
            x = solve_lm(residual, unknowns, record.thinned(_THIN), x, loss, gain=1e-9).x
        solver, solution = self._solve(unknowns, record, residual, x, loss)
        if unknowns.index("delay") in unknowns.free and not model.memory:
            record = _late_inertia(record, unknowns, solution.x)
            solver, solution = self._solve(unknowns, record, residual, solution.x, loss)
        if not solution.converged and not model.memory:  # along a valley its steps may be long and gain nothing
            again = solve_lm(residual, unknowns, record, solution.x, loss, gain=_NO_GAIN)
            solution = replace(solution, converged=again.converged)
        if not model.memory:
            unknowns, solution = with_possible_viscosity(residual, unknowns, record, loss, solution)
        if not np.isfinite(solution.x).all() or not np.isfinite(solution.cost):
            raise NotFitted("diverged", "the fit ended in numbers that are not finite")
        notes += rivals(residual, unknowns, record, solution, minima, loss)
        solution = in_order(model, unknowns, solution)
        if loss.kind == "linear":
            solution = correct_attenuation(residual, record, unknowns, solution)
        return FitOutcome(
            settings, self._problem, samples, rows, course, motion, by_force, self._sources, unknowns, linear,
            record, residual, solution, solver, loss, tuple(notes), begins_in_contact,
        )  # fmt: skip

    def _start(self, unknowns: Unknowns, record: FitRecord, loss: LossFunction) -> tuple[Floats, list[Solution]]:
        """Return values (P,) of all parameters to start from, and the minima near other starts, the least first."""
        model, linear = self._problem.model, self._linear_places(unknowns)
        if moduli := moduli_of(model, unknowns, linear):
            starts = guess_by_contrast(model, unknowns, record, linear, moduli)
            minima = solve_from_each(self._residual(unknowns.free), unknowns, record.thinned(_THIN), starts, loss)
            return minima[0].x, minima
        return first_guess(model, unknowns, record, linear, self._residual), []

    def _begins_in_contact(self, samples: Samples) -> bool:
        """Return True if nothing shows that the record begins in air; see `begins_in_contact`."""
        if self._settings.contact_point != "free" or self._problem.model.adhesive:
            return False
        is_stated = self._problem.force_zero == "stated" or not self._may_find_zero
        return begins_in_contact(samples, self._unknowns if is_stated else self._biased, self._misfit)

    def _misfit(self, samples: Samples, unknowns: Unknowns) -> tuple[float, float]:
        """Return what a fit to some samples leaves: sum of squares [N^2], and how many independent samples it is of."""
        course = passage(samples)
        motion = zero_phase_motion(samples, self._settings.smoothing, self._longest_window(samples, course.travel))
        record = self._record(samples, np.ones(len(samples), bool), motion, course)
        if not self._problem.model.memory:
            record = record.thinned(_THIN)
        residual = self._residual(unknowns.free)
        solution = self._solve(unknowns, record, residual, self._start(unknowns, record, _SQUARES)[0], _SQUARES)[1]
        found = scatter(residual, record, solution.x, _SQUARES)
        return found.rss, found.effective_samples

    @property
    def _may_find_zero(self) -> bool:
        """True if the settings leave it to the record whether the zero of the force is an unknown."""
        return self._settings.unknowns is None and "bias" not in self._settings.fixed

    def _prepared(
        self,
        samples: Samples,
        rows: Rows,
        by_force: SurfaceByForce,
        notes: list[Flag],
    ) -> Unknowns:
        """Return the unknowns with what only the record can say: whether it determines the bias, where the surface
        may be."""
        settings, unknowns = self._settings, self._unknowns
        if self._may_find_zero and self._problem.force_zero == "open" and samples.contact[0]:
            unknowns = self._biased
        air = int(np.count_nonzero(rows & ~samples.contact))
        if self._may_find_zero and air > _AIR_SHARE * np.count_nonzero(rows):
            unknowns = self._biased
        if settings.contact_point != "free":
            if settings.contact_point not in by_force.points:
                raise NotFitted(
                    "not-fitted", f'contact_point "{settings.contact_point}" finds no surface in this record'
                )
            unknowns = unknowns.changed("surface", free=False, value=by_force.points[settings.contact_point].surface)
        elif settings.force_uncertainty is not None:
            unknowns = self._constrained(unknowns, by_force.approach, settings.force_uncertainty, notes)
        return unknowns

    @cached_property
    def _biased(self) -> Unknowns:
        return self._unknowns.changed("bias", free=True)

    @staticmethod
    def _constrained(unknowns: Unknowns, approach: Approach | None, limit: float, notes: list[Flag]) -> Unknowns:
        if approach is None:
            what = "the record has no approach through air that force_uncertainty could use"
            notes.append(Flag("force-constraint-unused", what))
            return unknowns
        mean, std = float(approach.force[: approach.air].mean()), approach.noise / np.sqrt(approach.air)
        if limit < abs(mean) + 3.0 * std:
            what = (
                f"force_uncertainty of {limit:.3g} N is less than the force is off in air, {mean:+.3g} N, and 3 sigma "
                f"of its mean, {3 * std:.2g} N"
            )
            notes.append(Flag("force-constraint-tight", what))
        lowest = constrained_surface(approach, limit)
        item = unknowns.items[unknowns.index("surface")]
        if lowest >= item.upper:
            raise NotFitted(
                "not-fitted", "bounds of the surface and force_uncertainty contradict each other in this record"
            )
        return unknowns.changed("surface", lower=max(item.lower, lowest))

    def _record(self, samples: Samples, rows: Rows, motion: TipTravel, course: RecordCourse) -> FitRecord:
        weight = rows.astype(float)
        if self._settings.weights == "depth":
            weight[rows] = _by_depth(samples.position[rows])
        weight[rows] *= _by_digit(samples.force[rows])
        keep, remembers = rows.copy(), bool(self._problem.model.memory)
        if remembers:
            keep[: int(np.flatnonzero(rows)[-1]) + 1] = True
        known = np.isfinite(samples.force)
        force = samples.force if known.all() else np.where(known, samples.force, 0.0)
        columns: tuple[Floats, ...] = (samples.position, motion.rate, motion.acceleration, force, samples.time, weight)
        smooth = smooth_height(samples, motion.window) if remembers else samples.position
        if not keep.all():
            columns, smooth = tuple(column[keep] for column in columns), smooth[keep]
        travel = max(course.travel, 1e-12)
        if not remembers:
            return make_record(columns, travel, remembers)
        width = round(motion.window / max(median(samples.interval[1:]), 1e-12))
        return replace(make_record(columns, travel, smooth=(smooth, width)), rate_noise=motion.rate_noise)

    def _longest_window(self, samples: Samples, travel: float) -> float:
        """Window [s] beyond which the motion is not smoothed: a model with memory adds up what is blurred."""
        longest = longest_window(self._problem.model, max(travel, 1e-12))
        return min(longest, cubic_window(samples)) if self._problem.model.memory else longest

    def _linear_places(self, unknowns: Unknowns) -> tuple[int, ...]:
        free = unknowns.free
        if free not in self._linear:
            self._linear[free] = tuple(linear_places(self._problem.model, unknowns))
        return self._linear[free]

    def _residual(self, free: tuple[int, ...]) -> Residual:
        if free not in self._residuals:
            self._residuals[free] = Residual(self._problem.model, free)
        return self._residuals[free]

    def _solve(
        self,
        unknowns: Unknowns,
        record: FitRecord,
        residual: Residual,
        x: Floats,
        loss: LossFunction,
    ) -> tuple[str, Solution]:
        if self._problem.model.memory and times_of(unknowns):
            return "trf", solve_from_many(self._residual, unknowns, record, x, loss)
        if self._problem.model.memory:
            return "trf", solve_or_try_others(self._residual, unknowns, record, x, loss)
        if self._settings.solver != "trf":
            return "lm", solve_lm(residual, unknowns, record, x, loss)
        return "trf", solve_trf(residual, unknowns, record, x, loss)


def _late_inertia(record: FitRecord, unknowns: Unknowns, x: Floats) -> FitRecord:
    """The record with the tip's inertia as late as the rest of the force, to first order in what is left of the delay.

    The residual takes inertia as it is now, since it has no derivative of the acceleration.
    """
    mass, late = (float(x[unknowns.index(name)]) for name in ("tip_mass", "delay"))
    before = np.interp(record.time - late, record.time, record.acceleration)
    return record.with_force(record.force + mass * (record.acceleration - before))


def _spread(found: Estimates, samples: Samples, known: Rows) -> Estimates:
    """Estimates for the known among the samples, as estimates for all of them."""
    whole = Estimates.idle(samples, found.values.shape[1])
    for name in ("values", "std", "surface", "surface_std", "force", "nis", "status", "innovation"):
        getattr(whole, name)[known] = getattr(found, name)
    return replace(
        whole,
        details=found.details,
        flags=found.flags,
        report=found.report,
        timing_included=found.timing_included,
    )


def _without_saturation(samples: Samples, rows: Rows, notes: list[Flag]) -> Rows:
    """Drop readings that stand at the largest value of the record, and say so."""
    limited = rows & at_limit(samples.force, samples.position, rows)
    if not limited.any():
        return rows
    top = float(samples.force[limited][0])
    what = f"the force stands at {top:.5g} N in {np.count_nonzero(limited)} samples, which are left out"
    notes.append(Flag("saturated", what))
    return np.asarray(rows & ~limited)


def _by_digit(force: Floats) -> Floats:
    """Weights (n,) by which a plateau of equal readings (n,) [N] counts as one; 1 where noise exceeds half a digit."""
    known = np.isfinite(force)
    weight, digit = np.ones(len(force)), LastDigit.of(force[known])
    if digit.exceeds_noise(force[known]):
        weight[known] = 1.0 / np.sqrt(digit.plateau_sizes(force[known]))
    return weight


def _by_depth(height: Floats) -> Floats:
    """Weights (n,) that make every stretch of height count the same, 1 on average."""
    place = np.clip((height - height.min()) / max(float(np.ptp(height)), 1e-300) * 50, 0, 49).astype(int)
    weight = 1.0 / np.sqrt(np.bincount(place, minlength=50)[place])
    return np.asarray(weight / np.sqrt(np.mean(weight**2)))
