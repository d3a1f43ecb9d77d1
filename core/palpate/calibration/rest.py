"""At rest in free air: what the sensor reads, how it drifts, and how noisy everything is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.calibration.quantity import Scatter
from palpate.calibration.record import Record
from palpate.calibration.segments import Segment
from palpate.calibration.sines import mean_with_std

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Rest:
    """One stretch at rest."""

    time: float  # [s] its middle
    offset: Scatter  # [N]
    force_std: Scatter  # [N] of one reading, without what drifts
    velocity_std: Scatter | None  # [m/s]
    position_std: Scatter  # [m]
    colour: float  # noise density below a tenth of the rate over that of white noise of the same std; 1: white


@dataclass(frozen=True)
class RestFit:
    """All stretches at rest of one record."""

    offset: Scatter  # [N] at the first stretch
    drift: Scatter | None  # [N/s]; None where there is but one stretch
    rests: tuple[Rest, ...]


def rest_fit(record: Record, segments: Sequence[Segment]) -> RestFit:
    """Offset, drift and noise of a record's stretches at rest; one at least."""
    rests = tuple(_rest(record, segment) for segment in segments)
    return RestFit(rests[0].offset, _drift(rests), rests)


def _rest(record: Record, segment: Segment) -> Rest:
    force = record.force.between(segment.begin, segment.end)[1]
    velocity = None
    if record.velocity is not None:
        velocity = _white_std(record.velocity.between(segment.begin, segment.end)[1])
    return Rest(
        (segment.begin + segment.end) / 2,
        Scatter(*mean_with_std(force)),
        _white_std(force),
        velocity,
        _white_std(record.position.between(segment.begin, segment.end)[1]),
        _colour(force),
    )


def _white_std(values: Floats) -> Scatter:
    """Standard deviation of one reading about the stretch's straight line, sigma +- sigma/sqrt(2 (n - 2))."""
    n = len(values)
    t = np.linspace(-1.0, 1.0, n)
    rest = values - values.mean() - t * (t * values).sum() / (t**2).sum()
    std = float(np.sqrt((rest**2).sum() / (n - 2)))
    return Scatter(std, std / np.sqrt(2.0 * (n - 2)), n - 2.0)


def _colour(force: Floats) -> float:
    """How much of the noise is slow, where 1 is white; much above it the noise does not average out by its number."""
    line = np.linspace(-1.0, 1.0, len(force))
    level = force - force.mean()
    power = np.abs(np.fft.rfft(level - line * (line * level).sum() / (line**2).sum()))[1:] ** 2
    slow = power[: max(len(power) // 5, 1)]
    return float(slow.mean() / power.mean()) if power.any() else 1.0


def _drift(rests: Sequence[Rest]) -> Scatter | None:
    """Slope of the offsets over time, weighted by their uncertainty."""
    if len(rests) < 2:
        return None
    t = np.array([rest.time for rest in rests])
    y = np.array([rest.offset.value for rest in rests])
    w = np.array([max(rest.offset.std, 1e-12) ** -2 for rest in rests])
    since = t - (w * t).sum() / w.sum()
    information = float((w * since**2).sum())
    freedom = sum(rest.offset.freedom for rest in rests)
    return Scatter(float((w * since * y).sum() / information), information**-0.5, freedom)
