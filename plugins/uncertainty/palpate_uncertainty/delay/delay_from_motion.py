"""The delay of the force that a rich motion determines by itself, under several laws of the material."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Bias, Diagnosed, Flag, Floats, TrackEvidence
from palpate_kit.numerics.normal_equations import standard_errors
from palpate_kit.terminal.quantities import value_with_unit

from palpate_uncertainty.delay.timed_record import LATEST, ResponseLaw, TimedRecord, white_noise
from palpate_uncertainty.delay.timing_shift import is_viscous
from palpate_uncertainty.refit import Course, possible, sweeps
from palpate_uncertainty.relaxation_alternatives import relaxing_share
from palpate_uncertainty.whiteness import oscillation

_MEASURED = frozenset({"delay"})  # the fact that the motion determines
# Of decision 0153.
_MAX_RELATIVE_STD = 0.3  # of a viscosity with an unknown delay, below which the motion is rich
_MAX_BIC_DIFFERENCE = 10.0  # from the best law, within which one counts by exp(-dBIC/2)
_MAX_BIC_OF_SPREAD = 30.0  # from the best law, within which one spreads the delay where no law is the model's own
_MIN_OTHER_SHARE = 0.2  # of the rate's variance, that more than one line must hold
# As in decision 0052: the sum of autocovariances ends at five of its own times (Sokal 1997).
_WINDOW_TIMES = 5.0  # of the residuals' own autocorrelation time, at which it is cut off
_MAX_LAGS = 50  # of that sum: a choice of time
# Choices.
_MIN_SAMPLES = 1000  # of a record that is looked at
_MAX_SURFACE_SHIFT = 1e-3  # [m] by which a law may move the surface
_TIMES_PER_DECADE = 4  # of the branches that make up a power law
_MIN_CORRECTION = 0.005  # of a value; a smaller one is not written


@dataclass(frozen=True)
class DelayFit:
    """A law with a delay, fitted to a record."""

    law: str
    delay: float  # [s]
    std: float  # [s]
    values: Floats  # (k,) of the Kelvin-Voigt model that gives the law's force without the delay
    values_std: Floats  # (k,)
    surface: float  # [m]
    bic: float


def diagnose_delay(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Of every track whose timing nobody has declared, or that looks for it, on a motion that determines it."""
    found: dict[str, Diagnosed] = {}
    for track in tracks:
        if is_rich(track):
            found[track.name] = _judged(track)
    return found


def is_rich(track: TrackEvidence) -> bool:
    """True where a track's motion distinguishes delay and viscosity, and nobody has declared its timing."""
    end, model = track.ending, track.model
    if end is None or end.settings.timing_uncertainty is not None or model.memory or model.adhesive:
        return False
    if track.tip_mass is None:  # an inertia that nobody takes off looks like a delay, too
        return False
    roles = [parameter.role for parameter in model.parameters]
    if sorted(str(role) for role in roles) != ["elastic", "viscous"] or not (track.values > 0).all():
        return False
    if np.count_nonzero(track.kept.used) < _MIN_SAMPLES or sweeps(track) or not possible(track):
        return False
    if one_line(track):
        return False
    record = TimedRecord.of(track)
    sigma, slopes = record.slopes(kelvin_voigt(), record.surface, 0.0, np.zeros(0), track.values)
    viscous = next(i for i, parameter in enumerate(model.parameters) if is_viscous(parameter))
    return float(standard_errors(slopes)[viscous]) * sigma < _MAX_RELATIVE_STD * float(track.values[viscous])


def kelvin_voigt() -> ResponseLaw:
    """Return the track's own law: an elastic and a viscous force."""
    return ResponseLaw("kelvin-voigt", lambda course, surface, numbers: _units(course, surface))


def _units(course: Course, surface: float) -> Floats:
    """Forces (n, 2) of one unit of each parameter; none out of contact."""
    touching = course.depth(surface) > 0
    found = [course.forces(np.where(np.arange(2) == i, 1.0, 0.0), surface) for i in range(2)]
    return np.where(touching[:, None], np.nan_to_num(np.column_stack(found)), 0.0)


def one_line(track: TrackEvidence) -> bool:
    """True where the tip oscillates with one frequency and little else, which is the noise of the motion."""
    used = track.kept.used & np.isfinite(track.kept.position) & np.isfinite(track.kept.velocity)
    time, speed = track.kept.time[used], track.kept.velocity[used]
    rhythm = oscillation(time, track.kept.position[used])
    if rhythm is None:
        return False
    noise = white_noise(speed) ** 2
    columns = np.column_stack([np.sin(rhythm[1]), np.cos(rhythm[1]), np.ones(len(speed))])
    left = speed - columns @ np.linalg.lstsq(columns, speed, rcond=None)[0]
    return float(np.var(left)) - noise < _MIN_OTHER_SHARE * (float(np.var(speed)) - noise)


def _laws(record: TimedRecord, elastic: int) -> list[ResponseLaw]:
    """Kelvin and Voigt's law, a power law of time (constant loss angle), and one branch that relaxes."""
    times, fastest, slowest = _times(record)

    def power(course: Course, surface: float, numbers: Floats) -> Floats:
        area = _units(course, surface)[:, elastic]
        return np.column_stack([_power(record, area, times, numbers), _before(course, times[::_TIMES_PER_DECADE])])

    def branch(course: Course, surface: float, numbers: Floats) -> Floats:
        area = _units(course, surface)[:, elastic]
        return np.column_stack([area, _arms(record, area, numbers), _before(course, np.exp(numbers))])

    return [
        kelvin_voigt(),
        ResponseLaw("power-law", power, (0.1,), (0.005,), (0.7,)),
        ResponseLaw("one-branch", branch, (float(np.log(0.02)),), (fastest,), (slowest,)),
    ]


def _richer(record: TimedRecord, elastic: int) -> list[ResponseLaw]:
    """Laws of a record that is not Kelvin and Voigt's: a spring and a power law, and two branches."""
    times, fastest, slowest = _times(record)

    def fractional(course: Course, surface: float, numbers: Floats) -> Floats:
        area = _units(course, surface)[:, elastic]
        past = _before(course, times[::_TIMES_PER_DECADE])
        return np.column_stack([area, _power(record, area, times, numbers), past])

    def branches(course: Course, surface: float, numbers: Floats) -> Floats:
        area = _units(course, surface)[:, elastic]
        return np.column_stack([area, _arms(record, area, numbers), _before(course, np.exp(numbers))])

    two = (float(np.log(0.02)), float(np.log(0.3)))
    return [
        ResponseLaw("fractional-kelvin-voigt", fractional, (0.3,), (0.005,), (0.95,)),
        ResponseLaw("two-branches", branches, two, (fastest, fastest), (slowest, slowest)),
    ]


def _times(record: TimedRecord) -> tuple[Floats, float, float]:
    """Times [s] of a power law's branches, and the logarithms of the shortest and longest of a branch alone."""
    span, step = record.course.span, record.step
    times = 10.0 ** np.arange(np.log10(step / 10.0), np.log10(10.0 * span), 1.0 / _TIMES_PER_DECADE)
    return times, float(np.log(step)), float(np.log(span))


def _power(record: TimedRecord, area: Floats, times: Floats, numbers: Floats) -> Floats:
    """Forces (n, 1) of a unit of modulus that fades by a power of time."""
    shares = times ** -float(numbers[0])
    parts = np.column_stack([relaxing_share(area, record.step / time) for time in times])
    return np.asarray(parts @ (shares / shares.sum()))[:, None]


def _arms(record: TimedRecord, area: Floats, numbers: Floats) -> Floats:
    """Forces (n, m) of a unit of modulus each that fades in a time."""
    return np.column_stack([relaxing_share(area, record.step / time) for time in np.exp(numbers).tolist()])


def _before(course: Course, times: Floats) -> Floats:
    """Forces (n, m) that had not faded when the record began, where it began in contact: their sizes are not known."""
    slow = times[times > course.span / 1000.0] if not course.from_air else times[:0]
    return np.exp(-(course.time - course.begin)[:, None] / slow[None, :])


def _fitted(record: TimedRecord, law: ResponseLaw, delay: float | None, inflation: float) -> DelayFit:
    """Return a law fitted with an unknown delay, or with a given one."""
    from scipy.optimize import least_squares

    free = delay is None
    scale = np.array([1e-4, *([1e-3] if free else []), *([1.0] * len(law.start))])
    lower = np.array([-_MAX_SURFACE_SHIFT, *([-LATEST] if free else []), *law.lower]) / scale
    upper = np.array([_MAX_SURFACE_SHIFT, *([LATEST] if free else []), *law.upper]) / scale
    start = np.array([0.0, *([0.0] if free else []), *law.start]) / scale

    def parts(x: Floats) -> tuple[float, float, Floats]:
        numbers = x * scale
        late = float(numbers[1]) if delay is None else delay
        return record.surface + float(numbers[0]), late, numbers[1 + free :]

    found = least_squares(
        lambda x: record.solved(law, *parts(x))[1], np.clip(start, lower, upper), bounds=(lower, upper),
        diff_step=1e-4, max_nfev=30,
    )  # fmt: skip
    surface, late, numbers = parts(found.x)
    weights, left = record.solved(law, surface, late, numbers)
    _, slopes = record.slopes(law, surface, late, numbers, weights)
    count = len(weights)
    if not free:
        slopes = np.delete(slopes, count + 1, axis=1)
    n, p = len(left) / inflation, slopes.shape[1]
    spread = standard_errors(slopes) * np.sqrt(float(left @ left) / (len(left) - p) * inflation)
    values, stds = _as_kelvin_voigt(record, law, surface, numbers, weights), spread[:2]
    bic = n * float(np.log(left @ left / len(left))) + p * float(np.log(n))
    return DelayFit(law.name, late, float(spread[count + 1]) if free else 0.0, values, stds, surface, bic)


def _as_kelvin_voigt(record: TimedRecord, law: ResponseLaw, surface: float, numbers: Floats, weights: Floats) -> Floats:
    """Parameters (2,) that Kelvin and Voigt's law needs for the force of another one, as it is without a delay."""
    if law.name == "kelvin-voigt":
        return weights
    target = (law.columns(record.course, surface, numbers) @ weights)[record.rows]
    units = _units(record.course, surface)[record.rows]
    up, down = (_units(record.course, surface + side)[record.rows] for side in (1e-6, -1e-6))
    values = np.linalg.lstsq(units, target, rcond=None)[0]
    columns = np.column_stack([units, (up - down) @ values / 2e-6])
    size = np.linalg.norm(columns, axis=0)
    return np.asarray((np.linalg.lstsq(columns / size, target, rcond=None)[0] / size)[:2])


def _inflation(left: Floats) -> float:
    """Variance of a mean of residuals over that of white ones, by a window that grows with it.

    A sum over all lags would scatter by a fifth for white residuals (Sokal 1997).
    """
    power, total = float(left @ left), 1.0
    for lag in range(1, min(_MAX_LAGS, len(left) // 4) if power else 1):
        total += 2.0 * float(left[lag:] @ left[:-lag]) / power
        if lag >= _WINDOW_TIMES * total:
            break
    return max(total, 1.0)


def _judged(track: TrackEvidence) -> Diagnosed:
    record = TimedRecord.of(track)
    elastic = next(i for i, parameter in enumerate(track.model.parameters) if parameter.role == "elastic")
    plain = kelvin_voigt()
    first = _fitted(record, plain, None, 1.0)
    record = record.with_inertia(first.delay)
    inflation = _inflation(record.solved(plain, first.surface, first.delay, np.zeros(0))[1])
    told = [_fitted(record, law, None, inflation) for law in _laws(record, elastic)]
    own, best = told[0], min(one.bic for one in told)
    if own.bic - best >= _MAX_BIC_DIFFERENCE:
        told += [_fitted(record, law, None, inflation) for law in _richer(record, elastic)]
        best = min(one.bic for one in told)
    admitted = [one for one in told if one.bic - best < _MAX_BIC_DIFFERENCE]
    names = [parameter.name for parameter in track.model.parameters]
    evidence = np.array([np.exp(0.5 * (best - one.bic)) for one in admitted])
    shares = evidence / evidence.sum()
    between = float(np.sqrt(shares @ np.array([one.delay - own.delay for one in admitted]) ** 2))
    spread = np.sqrt(shares @ np.array([one.values - own.values for one in admitted]) ** 2)
    table: dict[str, Any] = {
        "delay": own.delay, "delay_std": float(np.hypot(own.std, between)), "law": own.law,
        "laws": {
            one.law: {"delay": one.delay, "std": one.std, "bic": one.bic - best, "admitted": one in admitted}
            | dict(zip(names, one.values.tolist(), strict=True))
            for one in told
        },
    }  # fmt: skip
    by_law = ", ".join(f"{one.law} {1e3 * one.delay:.3g} +- {1e3 * one.std:.2g} ms" for one in admitted)
    wrong = own not in admitted
    included = track.ending is not None and "timing" in track.ending.included
    if wrong:
        table |= _by_another(told, best)
        text = f"the record is not {own.law}: {_said(table, told, best)}; {_beside(own)}"
        terms = dict(zip(names, spread.tolist(), strict=True))
        # A track that looks for the delay has no other word of it.
        known = _MEASURED if included else frozenset[str]()
        return Diagnosed((Flag("delay-by-law", text, effects=terms),), terms, table=table, known=known)
    if included:
        terms = {name: share for name, share in zip(names, spread.tolist(), strict=True) if share > 0}
        return Diagnosed(
            (Flag("self-timed", f"the delay of the force, by law: {by_law}", effects=terms),),
            terms,
            table=table,
            known=_MEASURED,
        )
    timed = _fitted(record.with_inertia(0.0), plain, 0.0, inflation)
    shifts, left = timed.values - own.values, np.hypot(own.values_std, spread)
    # What the estimator's own scatter holds already is not counted twice.
    rest = np.sqrt(np.maximum(left**2 - timed.values_std**2, 0.0))
    biases = {
        name: Bias(float(shift), float(std), shared=True)
        for name, shift, std in zip(names, shifts.tolist(), rest.tolist(), strict=True)
    }
    said = [
        f"{name} {value_with_unit(value - bias.shift, np.hypot(combined, bias.std or 0.0), parameter.unit)}"
        for (name, bias), parameter, value, combined in zip(
            biases.items(), track.model.parameters, track.values.tolist(), track.combined.tolist(), strict=True
        )
        if abs(bias.shift) > _MIN_CORRECTION * abs(value)
    ]
    corrected = f"; corrected: {', '.join(said)}" if said else ""
    text = f"the motion determines the delay of the force, by law: {by_law}{corrected}"
    effects = {name: abs(bias.shift) for name, bias in biases.items()}
    return Diagnosed((Flag("self-timed", text, effects=effects),), biases=biases, table=table, known=_MEASURED)


def _by_another(told: Sequence[DelayFit], best: float) -> dict[str, Any]:
    """Return the delay by the law that describes the record best, with the spread of those that nearly do.

    Every law but the material's own takes a part of the delay for itself, so that its own uncertainty says little.
    """
    chosen = min(told, key=lambda one: one.bic)
    apart = max(abs(one.delay - chosen.delay) for one in told if one.bic - best < _MAX_BIC_OF_SPREAD)
    return {"delay": chosen.delay, "delay_std": float(np.hypot(chosen.std, apart / np.sqrt(3.0))), "law": chosen.law}


def _said(table: Mapping[str, Any], told: Sequence[DelayFit], best: float) -> str:
    """That delay in words, and the other laws."""
    near = [f"{one.law} {1e3 * one.delay:.3g}" for one in told if 0 < one.bic - best < _MAX_BIC_OF_SPREAD]
    beside = f" (nearly as well: {', '.join(near)} ms)" if near else ""
    return f"by {table['law']} the delay is {1e3 * table['delay']:.3g} +- {1e3 * table['delay_std']:.2g} ms{beside}"


def _beside(own: DelayFit) -> str:
    return f"as {own.law} it would be {1e3 * own.delay:.3g} +- {1e3 * own.std:.2g} ms"
