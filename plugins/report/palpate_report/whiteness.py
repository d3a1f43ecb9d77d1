"""The autocorrelation of innovations, at the rate of the samples: a table of estimates has only one row in many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from palpate import Diagnosed, Floats, TrackEvidence

LAGS = 50  # samples of the autocorrelation: a choice
_MIN_INNOVATIONS = 100  # for an autocorrelation: a choice; 0.1 is then one standard deviation


def innovations(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the autocorrelation of each track's innovations at lags 1 to 50 over the later half of the record.

    Before, an estimate may still be on its way to rest. No flags: the core raises them itself.

    Innovations of a right model with the right noise are white: beyond 2/sqrt(n) one in twenty lags lies by chance
    (Mehra 1970).
    """
    findings = {}
    for track in tracks:
        kept = track.kept  # the samples of the record that are held, (n,) each
        if not kept.used.any():
            continue
        begin, end = kept.time[kept.used][[0, -1]].tolist()
        later = kept.used & (kept.time >= 0.5 * (begin + end))  # from the middle of the record on
        shares, count = autocorrelation(kept.index, np.where(later, kept.innovation, np.nan))
        if count >= _MIN_INNOVATIONS:
            step = float(np.median(np.diff(kept.time)))
            table = {"autocorrelation": [round(share, 5) for share in shares], "samples": count, "interval": step}
            findings[track.name] = Diagnosed(table=table)
    return findings


def autocorrelation(index: np.ndarray, values: Floats) -> tuple[list[float], int]:
    """Return the autocorrelation at lags 1 to 50 of values (n,) with gaps, and their number; index (n,) counts samples.

    Pairs over a gap, or with a value that is not known, do not count.
    """
    runs = np.split(values, np.flatnonzero(np.diff(index) != 1) + 1)
    # Behind each run as many unknown values as the longest lag, so that no pair lies over a gap.
    values = np.concatenate([part for run in runs for part in (run, np.full(LAGS, np.nan))])
    is_finite = np.isfinite(values).astype(float)
    values = np.where(is_finite > 0, values, 0.0)
    count, square = int(is_finite.sum()), float(values @ values)
    shares = []  # of the variance
    for lag in range(1, LAGS + 1):
        pairs = float(is_finite[lag:] @ is_finite[:-lag])
        mean = float(values[lag:] @ values[:-lag]) / pairs if pairs else 0.0
        shares.append(mean / (square / count) if square > 0 else 0.0)
    return shares, count
