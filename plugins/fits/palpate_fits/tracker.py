"""A fit at work: from the record to estimates, once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np
from palpate import Estimates, Flag, Floats, Problem, Samples
from palpate_kit.budget.uncertainty_sources import UncertaintySource
from palpate_kit.numerics.contact_point import Approach
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
from palpate_fits.contrast_guess import guess_by_contrast, moduli_of
from palpate_fits.first_guess import first_guess, linear_places
from palpate_fits.fit_outcome import FitOutcome
from palpate_fits.fit_samples import depth_weights, digit_weights, refuse_few_samples, without_saturation
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

# Choices.
_AIR_SHARE = 0.1  # of the fitted samples, above which those in air determine the bias
_THINNED_SAMPLES = 1000  # of a first fit, which the whole record needs few steps from
_THINNED_GAIN = 1e-9  # of the cost, below which a step of the first fit is its last one
_NO_GAIN = 1e-9  # of the cost: sqrt(10 000 * 1e-9) = 0.003 standard deviations from the minimum of 10 000 samples
_TIGHT_SIGMAS = 3.0  # of the mean force in air, that force_uncertainty should leave beyond it
_MIN_TRAVEL = 1e-12  # [m] in contact, in place of 0: below any resolution
_MIN_INTERVAL = 1e-12  # [s] between samples, in place of 0
_SQUARES = LossFunction()


@dataclass(frozen=True)
class _FitSegment:
    """The samples of a record that are fitted, with their motion and the unknowns that they determine."""

    samples: Samples  # of the whole record
    rows: Rows  # (n,) True for those that are fitted
    course: RecordCourse
    motion: TipTravel
    by_force: SurfaceByForce
    unknowns: Unknowns
    record: FitRecord
    begins_in_contact: Callable[[], bool]


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
        """Return the estimates of the whole record; constant over the fitted samples, and idle outside them."""
        from palpate_fits.report import estimates_of

        if not len(samples):
            return Estimates.idle(samples, len(self._problem.model.parameters))
        has_position = np.isfinite(samples.position)
        if not has_position.all():
            return _of_all_samples(self.run(samples[has_position]), samples, has_position)
        try:
            return estimates_of(self.fit(samples))
        except NotFitted as refusal:
            idle = Estimates.idle(samples, len(self._problem.model.parameters))
            return replace(idle, flags=(refusal.flag,))

    def fit(self, samples: Samples) -> FitOutcome:
        """Return the fit of a record; raises NotFitted where it cannot be done.

        The samples of the segment and the unknowns that the record determines; a start from a grid; the minimum; then
        what least squares leaves wrong there: the inertia of a late force, a viscosity below 0, and the attenuation by
        the noise of the height.
        """
        model, notes = self._problem.model, list[Flag]()
        segment = self._segment(samples, notes)
        unknowns, record = segment.unknowns, segment.record
        # Start and minimum.
        loss = LossFunction(self._settings.loss, self._settings.loss_scale)
        residual = self._residual(unknowns.free)
        x, minima = self._start(unknowns, record, loss)
        solver, record, solution = self._minimum(unknowns, record, residual, x, loss)
        # Corrections.
        if not model.memory:
            unknowns, solution = with_possible_viscosity(residual, unknowns, record, loss, solution)
        if not np.isfinite(solution.x).all() or not np.isfinite(solution.cost):
            raise NotFitted("diverged", "the fit ended in numbers that are not finite")
        notes += rivals(residual, unknowns, record, best=solution, minima=minima, loss=loss)
        solution = in_order(model, unknowns, solution)
        if loss.kind == "linear":
            solution = correct_attenuation(residual, record, unknowns, solution)
        return FitOutcome(
            settings=self._settings,
            problem=self._problem,
            samples=segment.samples,
            rows=segment.rows,
            course=segment.course,
            motion=segment.motion,
            by_force=segment.by_force,
            sources=self._sources,
            unknowns=unknowns,
            record=record,
            residual=residual,
            solution=solution,
            solver=solver,
            loss=loss,
            notes=tuple(notes),
            begins_in_contact=segment.begins_in_contact,
        )

    def _segment(self, samples: Samples, notes: list[Flag]) -> _FitSegment:
        """Return the samples of a record that are fitted, and the unknowns that they determine.

        Appends to the notes; raises NotFitted for too few samples, or without a surface where a method is to find it.
        """
        # A record in which nothing shows air counts as contact from its first sample.
        begins_in_contact = cache(partial(self._begins_in_contact, samples))
        is_without_air = self._problem.force_zero != "air" and begins_in_contact()
        if is_without_air:
            samples = touching_from_start(samples)
        # The heights of first touch and deepest point with the cycles; rate and acceleration by a symmetric window.
        course = passage(samples)
        motion = zero_phase_motion(samples, self._settings.smoothing, self._longest_window(samples, course.travel))
        rows = segment_rows(self._windows, samples, motion.rate, course)
        rows = without_saturation(samples, rows, notes)
        by_force = SurfaceByForce(samples, course, self._settings.threshold)
        # Unknowns that the record determines, within bounds that it can show.
        unknowns = self._unknowns_of_record(samples, rows, by_force, notes)
        if is_without_air:  # a viscosity below 0 would be a higher surface, see `one_speed_intervals`
            unknowns = at_physical_bounds(unknowns, self._problem.model)
        refuse_few_samples(rows, unknowns)
        record = self._record(samples, rows, motion, course)
        if self._problem.model.memory:
            unknowns = with_times_that_show(unknowns, record)
        return _FitSegment(
            samples=samples,
            rows=rows,
            course=course,
            motion=motion,
            by_force=by_force,
            unknowns=unknowns,
            record=record,
            begins_in_contact=begins_in_contact,
        )

    def _minimum(
        self, unknowns: Unknowns, record: FitRecord, residual: Residual, x: Floats, loss: LossFunction
    ) -> tuple[str, FitRecord, Solution]:
        """Return the solver's name, the record as it was fitted, and the minimum from a start (P,).

        Without memory a long record is fitted to some of its samples first; where the delay is an unknown, the inertia
        is made as late as the fit says, and the fit repeated; and a fit that has not converged counts as converged
        where further steps gain nothing, as they do along a valley.
        """
        if self._problem.model.memory:
            solver, solution = self._solve(unknowns, record, residual, x, loss)
            return solver, record, solution
        if len(record) > 2 * _THINNED_SAMPLES:  # of a shorter record a first fit would not be worth its time
            x = solve_lm(residual, unknowns, record.thinned(_THINNED_SAMPLES), x, loss, gain=_THINNED_GAIN).x
        solver, solution = self._solve(unknowns, record, residual, x, loss)
        if unknowns.index("delay") in unknowns.free:
            record = _late_inertia(record, unknowns, solution.x)
            solver, solution = self._solve(unknowns, record, residual, solution.x, loss)
        if not solution.converged:
            continued = solve_lm(residual, unknowns, record, solution.x, loss, gain=_NO_GAIN)
            solution = replace(solution, converged=continued.converged)
        return solver, record, solution

    def _start(self, unknowns: Unknowns, record: FitRecord, loss: LossFunction) -> tuple[Floats, list[Solution]]:
        """Return values (P,) of all parameters to start from, and the minima near other starts, the least first."""
        model, linear = self._problem.model, self._linear_places(unknowns)
        if moduli := moduli_of(model, unknowns, linear):
            starts = guess_by_contrast(model, unknowns, record, linear, moduli)
            thinned = record.thinned(_THINNED_SAMPLES)
            minima = solve_from_each(self._residual(unknowns.free), unknowns, thinned, starts, loss)
            return minima[0].x, minima
        return first_guess(model, unknowns, record, linear, self._residual), []

    def _begins_in_contact(self, samples: Samples) -> bool:
        """Return True if nothing shows that the record begins in air; see `begins_in_contact`."""
        if self._settings.contact_point != "free" or self._problem.model.adhesive:
            return False
        is_stated = self._problem.force_zero == "stated" or not self._may_find_zero
        return begins_in_contact(samples, self._unknowns if is_stated else self._biased, self._misfit)

    def _misfit(self, samples: Samples, unknowns: Unknowns) -> tuple[float, float]:
        """Return the sum of squared residuals [N^2] of a fit to samples, and the number of independent ones."""
        course = passage(samples)
        motion = zero_phase_motion(samples, self._settings.smoothing, self._longest_window(samples, course.travel))
        record = self._record(samples, np.ones(len(samples), bool), motion, course)
        if not self._problem.model.memory:
            record = record.thinned(_THINNED_SAMPLES)
        residual = self._residual(unknowns.free)
        start, _ = self._start(unknowns, record, _SQUARES)
        _, solution = self._solve(unknowns, record, residual, start, _SQUARES)
        residual_scatter = scatter(residual, record, solution.x, _SQUARES)
        return residual_scatter.rss, residual_scatter.effective_samples

    @property
    def _may_find_zero(self) -> bool:
        """True if the settings leave it to the record whether the zero of the force is an unknown."""
        return self._settings.unknowns is None and "bias" not in self._settings.fixed

    def _unknowns_of_record(
        self,
        samples: Samples,
        rows: Rows,
        by_force: SurfaceByForce,
        notes: list[Flag],
    ) -> Unknowns:
        """Return the unknowns with what the record determines: bias and surface, as the settings leave them open.

        Where the settings leave the zero of the force to the record (`_may_find_zero`), the bias is free if more than a
        tenth of the fitted samples (`rows`) are in air, or the record begins in contact and nobody states a zero. The
        surface is fixed at the contact point of a method; free, it has a lower bound by `force_uncertainty`, where that
        is stated (`_constrained`, which appends to the notes). Raises NotFitted where the method finds no contact
        point, or that bound contradicts others.
        """
        settings, unknowns = self._settings, self._unknowns
        in_air = int(np.count_nonzero(rows & ~samples.contact))
        has_enough_air = in_air > _AIR_SHARE * np.count_nonzero(rows)
        is_zero_unknown = self._problem.force_zero == "open" and bool(samples.contact[0])
        if self._may_find_zero and (has_enough_air or is_zero_unknown):
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
        """Return the unknowns with the surface above the heights at which the force exceeds a limit [N].

        `approach` has heights and forces of the first way in, of which the first `approach.air` samples are in air.
        Appends a note where the limit cannot be used, or is less than the error of the force in air; raises NotFitted
        where it contradicts the bounds of the surface.
        """
        if approach is None:
            text = "the record has no approach through air that force_uncertainty could use"
            notes.append(Flag("force-constraint-unused", text))
            return unknowns
        # A limit below the error of the force in air restricts the surface by noise alone.
        mean, std = float(approach.force[: approach.air].mean()), approach.noise / np.sqrt(approach.air)
        if limit < abs(mean) + _TIGHT_SIGMAS * std:
            text = (
                f"force_uncertainty of {limit:.3g} N is less than the force is off in air, {mean:+.3g} N, and "
                f"{_TIGHT_SIGMAS:g} sigma of its mean, {_TIGHT_SIGMAS * std:.2g} N"
            )
            notes.append(Flag("force-constraint-tight", text))
        lowest = constrained_surface(approach, limit)
        item = unknowns.items[unknowns.index("surface")]
        if lowest >= item.upper:
            raise NotFitted(
                "not-fitted", "bounds of the surface and force_uncertainty contradict each other in this record"
            )
        return unknowns.changed("surface", lower=max(item.lower, lowest))

    def _record(self, samples: Samples, rows: Rows, motion: TipTravel, course: RecordCourse) -> FitRecord:
        """Return the columns of the fitted samples; for a model with memory all up to the last, as their history.

        `rows` (n,) are the fitted samples, `motion` is smoothed without a delay, `course` has the travel in contact.
        """
        # The weights of the samples; those of a memory's past alone are 0.
        weight = rows.astype(float)
        if self._settings.weights == "depth":
            weight[rows] = depth_weights(samples.position[rows])
        weight[rows] *= digit_weights(samples.force[rows])
        keep, has_memory = rows.copy(), bool(self._problem.model.memory)
        if has_memory:
            keep[: int(np.flatnonzero(rows)[-1]) + 1] = True
        # A missing force of the past is not read, and must be finite.
        has_force = np.isfinite(samples.force)
        force = samples.force if has_force.all() else np.where(has_force, samples.force, 0.0)
        columns: tuple[Floats, ...] = (samples.position, motion.rate, motion.acceleration, force, samples.time, weight)
        smooth = smooth_height(samples, motion.window) if has_memory else samples.position
        if not keep.all():
            columns, smooth = tuple(column[keep] for column in columns), smooth[keep]
        travel = max(course.travel, _MIN_TRAVEL)
        if not has_memory:
            return make_record(columns, travel, has_memory)
        width = round(motion.window / max(median(samples.interval[1:]), _MIN_INTERVAL))
        return replace(make_record(columns, travel, smooth=(smooth, width)), rate_noise=motion.rate_noise)

    def _longest_window(self, samples: Samples, travel: float) -> float:
        """Return the longest window [s] of the smooth motion: a model with memory adds up what is blurred."""
        longest = longest_window(self._problem.model, max(travel, _MIN_TRAVEL))
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
        """Return the solver's name and the minimum from a start (P,), by the solver of the settings and the model."""
        if self._problem.model.memory and times_of(unknowns):
            return "trf", solve_from_many(self._residual, unknowns, record, x, loss)
        if self._problem.model.memory:
            return "trf", solve_or_try_others(self._residual, unknowns, record, x, loss)
        if self._settings.solver != "trf":
            return "lm", solve_lm(residual, unknowns, record, x, loss)
        return "trf", solve_trf(residual, unknowns, record, x, loss)


def _late_inertia(record: FitRecord, unknowns: Unknowns, x: Floats) -> FitRecord:
    """Return the record with the tip's inertia as late as the rest of the force, by the estimated delay.

    The residual has the inertia m a(t) of the instant, since it has no derivative of the acceleration; m a(t - tau) is
    what a force late by tau reads, so that m (a(t) - a(t - tau)) is added to the force.
    """
    mass, delay = (float(x[unknowns.index(name)]) for name in ("tip_mass", "delay"))
    delayed = np.interp(record.time - delay, record.time, record.acceleration)
    return record.with_force(record.force + mass * (record.acceleration - delayed))


def _of_all_samples(estimates: Estimates, samples: Samples, has_position: Rows) -> Estimates:
    """Return estimates of the samples whose position is known as estimates of all samples, idle at the others."""
    whole = Estimates.idle(samples, estimates.values.shape[1])
    for name in ("values", "std", "surface", "surface_std", "force", "nis", "status", "innovation"):
        getattr(whole, name)[has_position] = getattr(estimates, name)
    return replace(
        whole,
        details=estimates.details,
        flags=estimates.flags,
        report=estimates.report,
        timing_included=estimates.timing_included,
    )
