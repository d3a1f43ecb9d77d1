"""Outliers: readings of the force that no motion and no noise explains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from palpate import Diagnosed, Flag, Floats, TrackEvidence

from palpate_uncertainty.channel_noise import MEDIAN_TO_STD
from palpate_uncertainty.force_noise import ForceNoise

# Choices: a spike stands out of its neighbours so far that noise does not in any record.
_REACH = 5  # samples to either side, of the running median
_SIGNIFICANT = 8.0  # [standard deviations] of the noise
_MIN_SAMPLES = 100  # for a noise by their median
_MAX_WINDOWS = 65_536  # that are sorted together: a choice of memory
_SECOND_DIFFERENCE_VARIANCE = 6.0  # variance of second differences of white noise of variance 1: 1 + 4 + 1


def outliers(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the finding on each track whose force contains spikes; a flag if its estimator gives them full weight."""
    findings: dict[str, Diagnosed] = {}
    for track in tracks:
        used = track.kept.used
        force = _residual(track)[used]
        noise = ForceNoise.of(track, force)
        spikes = spikes_of(force, ~track.kept.hesitating[used], noise.std if noise is not None else 0.0)
        if not len(spikes):
            continue
        share, size = len(spikes) / len(force), float(np.max(np.abs(spikes)))
        table = {"count": len(spikes), "share": share, "largest": size}
        text = f"{len(spikes)} readings of the force ({100 * share:.2g} %) are spikes of up to {size:.2g} N"
        flags = () if track.estimator.robust else (Flag("outliers", f"{text}, which this estimator gives full weight"),)
        findings[track.name] = Diagnosed(flags, table=table)
    return findings


def _residual(track: TrackEvidence) -> Floats:
    """Return the residual (n,) [N] of the force by a fit; the force itself without one."""
    report, innovation = track.report, track.kept.innovation
    if report is None or not report.rss > 0 or not np.isfinite(innovation[track.kept.used]).all():
        return track.kept.force
    return np.asarray(innovation * np.sqrt(report.rss / report.samples))


def spikes_of(force: Floats, judged: NDArray[np.bool_], noise: float = 0.0) -> Floats:
    """Return the distances [N] of judged readings from the median of their neighbours, beyond 8 standard deviations.

    The noise follows from the median size of second differences, whose variance is 6 times that of white noise. It is
    at least the smallest step of the readings and the noise [N] of the air: a channel that is filtered or held hardly
    changes. Source: Hampel 1974.
    """
    judged, force = judged[np.isfinite(force)], force[np.isfinite(force)]
    if len(force) < _MIN_SAMPLES:
        return np.zeros(0)
    distance = force - _running_median(force)
    # The noise, by second differences.
    steps = np.abs(np.diff(force))
    least_step = float(steps[steps > 0].min()) if (steps > 0).any() else 0.0
    size = MEDIAN_TO_STD * float(np.median(np.abs(np.diff(force, 2))))
    scale = max(size / np.sqrt(_SECOND_DIFFERENCE_VARIANCE), least_step, noise)
    # A fast motion is not a spike, as the neighbouring readings change by it as well: within the reach of the median
    # the force moves by its slope times the reach, and twice that is allowed (choice).
    limit = _SIGNIFICANT * scale + 2.0 * _running_median(np.abs(np.gradient(force))) * _REACH
    return distance[judged & (np.abs(distance) > limit)] if scale > 0 else np.zeros(0)


def _running_median(values: Floats) -> Floats:
    """Return the median (n,) of each value and its neighbours, the outermost repeated beyond both ends."""
    medians = np.empty(len(values))
    padded = np.pad(values, _REACH, mode="edge")
    for start in range(0, len(values), _MAX_WINDOWS):
        part = padded[start : start + _MAX_WINDOWS + 2 * _REACH]
        windows = np.lib.stride_tricks.sliding_window_view(part, 2 * _REACH + 1)
        medians[start : start + len(windows)] = np.partition(windows, _REACH, axis=1)[:, _REACH]
    return medians
