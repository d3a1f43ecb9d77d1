"""Flags: failed assumptions, each as a short code and a sentence for people."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from palpate.alignment import AlignmentReport, AlignmentSettings
from palpate.contact import ContactModel, contact_force
from palpate.estimation import Status
from palpate.result.record import Tail, TrackRecord

_STILL_MOVING = 0.02  # of a value: slope times time tracked
_NIS_RANGE = (0.5, 1.6)  # of the mean over the last second; 0.9 to 1.1 would be one by chance alone
_COLOURED = 0.3  # autocorrelation of innovations; 0.1 comes by chance alone
_PAPER_NOISE = 0.05  # [N]
_MILLISECOND = 1e-3  # [s]
_HARDLY = 0.01  # of a parameter
_WEAK = 5.0  # the force must swing by more than so many standard deviations of its noise
_SURFACE_TOLERANCE = 5e-4  # [m] between the surface that a track finds and the one that the first touch says
_LATE = 1e-3  # [s] of the velocity against the position
_DRIFT = 5e-4  # [s] between the clocks of two streams over a record
_AIR = 0.05  # [N] before the first touch
_STUCK = 0.1  # [s] of exactly equal readings

Flag = str


def flag(code: str, text: str) -> Flag:
    """``code: text``; the code is for programs."""
    return f"{code}: {text}"


def alignment_flags(report: AlignmentReport, settings: AlignmentSettings) -> Iterator[Flag]:
    """What was amiss with the record, whatever is estimated from it."""
    for name, health in report.streams.items():
        counts = {
            "invalid": health.invalid,
            "duplicates": health.duplicates,
            "backwards": health.backwards,
            "gaps": health.gaps,
            "saturated": health.saturated,
        }
        words = {
            "invalid": "invalid readings",
            "duplicates": "repeated time-stamps",
            "backwards": "time going backwards",
            "gaps": "gaps",
            "saturated": "saturated readings",
        }
        for code, count in counts.items():
            if count:
                yield flag(code, f"{name} has {count} x {words[code]}")
        if health.rate and health.longest_repeat / health.rate > _STUCK:
            yield flag("stuck", f"{name} repeats one reading for {health.longest_repeat / health.rate:.2f} s")
    if report.missing_force:
        yield flag("missing-force", f"{report.missing_force} of {report.samples} samples have no force")
    if report.missing_velocity > 1:
        yield flag("missing-velocity", f"{report.missing_velocity} of {report.samples} samples have no velocity")
    if report.velocity_delay is not None:
        late, uncertainty = report.velocity_delay
        if abs(late) > max(_LATE, 5 * uncertainty):
            what = f"the velocity is {1e3 * late:.2g} ms late against the position: filtered, or of another clock"
            yield flag("velocity-late", what)
    yield from _drift_flags(report, settings)
    if settings.tare == "free-air" and (report.tare is None or report.tare.noise is None):
        yield flag("no-tare", "the record is too short, or has no force, for a tare in free air")
    if report.air_force is not None and abs(report.air_force) > _AIR:
        yield flag("untared", f"before the first touch the force is {report.air_force:+.2g} N, where it should be none")
    if report.touches > 1:
        yield flag("touched-again", f"contact was lost and found again {report.touches - 1} times")


def _drift_flags(report: AlignmentReport, settings: AlignmentSettings) -> Iterator[Flag]:
    """Clocks of force and motion that do not run alike, by the clock that logged both."""
    signals = [s for s in (settings.force, settings.position, settings.velocity) if s is not None and s.time == "stamp"]
    streams = dict.fromkeys(signal.channel.rpartition(".")[0] for signal in signals)
    gained = {name: h.gained for name in streams if (h := report.streams.get(name)) is not None}
    known = [(name, gain) for name, gain in gained.items() if gain is not None]
    for name, gain in known[1:]:
        first, reference = known[0]
        if abs(gain - reference) > _DRIFT:
            ahead, behind = (name, first) if gain > reference else (first, name)
            late = f"{1e3 * abs(gain - reference):.2g} ms"
            yield flag("clock-drift", f"the time-stamps of {ahead} gain {late} on those of {behind} over the record")


def track_flags(
    record: TrackRecord, model: ContactModel, report: AlignmentReport, average: float, online: bool = True
) -> Iterator[Flag]:
    """What is amiss with one track; an offline estimate is constant, so it neither drifts nor has innovations."""
    yield from record.flags
    tail = record.tail
    if tail is None and record.marks[Status.WAITING]:
        yield flag("never-started", f"{record.marks[Status.WAITING]} samples in contact were too few to start on")
        return
    if tail is None:
        if record.flags:  # the estimator has said why
            return
        yield flag("no-contact", f"the force never stayed above {report.touch_force:.3g} N: nothing was estimated")
        return
    yield from _status_flags(record)
    if record.marks[Status.DIVERGED]:
        return
    end = float(tail.time[-1])
    last = tail.since(end - average)
    yield from _bound_flags(last, model)
    if online:
        yield from _convergence_flags(tail, last, model, average, record.tracked)
    yield from _force_flags(last, report)
    yield from _surface_flags(last, model, report)


def _status_flags(record: TrackRecord) -> Iterator[Flag]:
    marks = record.marks
    if marks[Status.DIVERGED]:
        yield flag("diverged", "the estimates stopped being finite or plausible numbers; none can be used")
    if marks[Status.LIFTED]:
        yield flag(
            "depth-not-positive", f"the estimated depth was not positive in {marks[Status.LIFTED]} samples in contact"
        )
    if marks[Status.RESTARTED]:
        yield flag("restarted", f"the filter began anew {marks[Status.RESTARTED]} times")
    if marks[Status.BLIND]:
        yield flag("blind", f"{marks[Status.BLIND]} samples lacked a measurement and were predicted only")
    if marks[Status.STIFF]:
        yield flag("too-stiff", f"the contact was too stiff for the time step in {marks[Status.STIFF]} samples")
    if marks[Status.REPAIRED]:
        yield flag("covariance-repaired", f"the covariance lost its positivity in {marks[Status.REPAIRED]} samples")
    if marks[Status.RESUMED]:
        yield flag("resumed", f"the estimate was carried over a pause {marks[Status.RESUMED]} times")


def _bound_flags(last: Tail, model: ContactModel) -> Iterator[Flag]:
    for column, parameter in enumerate(model.parameters):
        value = float(last.values[:, column].mean())
        if not parameter.lower < value < parameter.upper:
            yield flag("implausible", f"{parameter.name} of {value:.3g} {parameter.unit} is outside what is possible")


def _convergence_flags(tail: Tail, last: Tail, model: ContactModel, average: float, tracked: float) -> Iterator[Flag]:
    """Whether the estimates have come to rest, and the innovations are as large as the filter expects."""
    if tracked < 2 * average or len(tail.time) < 10:
        yield flag("not-converged", f"only {tracked:.2g} s were tracked")
        return
    moving = []
    for column, parameter in enumerate(model.parameters):
        value, rest = float(last.values[:, column].mean()), float(tail.unsettled(tail.values, tracked)[column])
        if rest > max(_STILL_MOVING * abs(value), 3.0 * float(last.std[-1, column])):
            moving.append(f"{parameter.name} by {100 * rest / tracked / abs(value):.2f} % a second")
    if moving:
        yield flag("not-converged", f"still moving after {tracked:.3g} s: {', '.join(moving)}")
    nis = float(np.nanmean(last.nis)) if np.isfinite(last.nis).any() else float("nan")
    if not np.isnan(nis) and not _NIS_RANGE[0] <= nis <= _NIS_RANGE[1]:
        yield flag(
            "inconsistent", f"NIS of {nis:.2g} in the last {average:g} s where 1 is expected: noise or model is wrong"
        )
    lag, share = tail.correlation()
    if abs(share) > _COLOURED:
        found = f"innovations {lag} samples apart correlate by {share:+.2f}"
        yield flag("coloured-innovations", f"{found}: the model misses something, or the data are filtered")


def _force_flags(last: Tail, report: AlignmentReport) -> Iterator[Flag]:
    noise = report.tare.noise if report.tare and report.tare.noise else _PAPER_NOISE
    swing = float(np.nanmax(last.model_force) - np.nanmin(last.model_force))
    if swing < _WEAK * noise:
        yield flag("not-identifiable", f"the force swings by {swing:.2g} N against a noise of {noise:.2g} N")


def _surface_flags(last: Tail, model: ContactModel, report: AlignmentReport) -> Iterator[Flag]:
    """The model at the estimate must give the force of first touch where the first touch was."""
    if report.first_touch is None or report.tare is None or report.tare.noise is None or model.memory:
        return  # what a material that relaxes answers to a first touch depends on the approach
    theta, surface = last.values.mean(axis=0), float(last.surface.mean())
    depths = np.linspace(0.0, 0.02, 2001)
    force = contact_force(model, depths, 0.0, theta)
    expected = float(depths[min(int(np.searchsorted(force, report.touch_force)), len(depths) - 1)])
    apart = surface - (report.first_touch[1] + expected)
    if abs(apart) > _SURFACE_TOLERANCE:
        yield flag("surface-mismatch", f"the estimated surface is {1e3 * apart:+.2f} mm from where the tip touched")


def validity_flags(model: ContactModel, last: Tail) -> Iterator[Flag]:
    """What the model says against itself at the greatest depth that was reached."""
    depth = float(np.max(last.surface - last.position)) if len(last.time) else 0.0
    problem = model.validity(depth) if np.isfinite(depth) and depth > 0 else ""
    if problem:
        yield flag("beyond-model-range", problem)


def timing_flags(
    model: ContactModel, values: NDArray[np.float64], shifts: NDArray[np.float64], uncertainty: float | None
) -> Iterator[Flag]:
    """Parameters that a force or motion recorded late would shift, against the declared timing uncertainty [s].

    `shifts` (k,) are those of `delay_shifts`. Left out: what is not viscous and moves by less than a hundredth in 1 ms.
    """
    for parameter, value, shift in zip(model.parameters, values.tolist(), shifts.tolist(), strict=True):
        if not shift or (parameter.role != "viscous" and abs(shift) * _MILLISECOND <= _HARDLY * abs(value)):
            continue
        if uncertainty is None:
            per_ms = f"{abs(shift) * _MILLISECOND:.3g} {parameter.unit}"
            yield flag("timing-undeclared", f"no timing uncertainty is declared; 1 ms is {per_ms} of {parameter.name}")
        elif abs(value) < 2 * abs(shift) * uncertainty:
            yield flag(
                "not-distinguishable-from-delay", f"{parameter.name} is within {uncertainty * 1e3:.3g} ms of none"
            )


def compliance_flags(shares: Mapping[str, float], stiffness: float | None) -> Iterator[Flag]:
    """Parameters that a robot which gives way shifts by more than a hundredth; `shares` of their values by name."""
    strong = [f"{name} by {100 * share:.2g} %" for name, share in shares.items() if share > _HARDLY]
    if stiffness is not None and strong:
        yield flag(
            "series-compliance",
            f"robot and sensor give way with {1e-3 * stiffness:.3g} N/mm, which shifts {', '.join(strong)}; it is not "
            "corrected",
        )
