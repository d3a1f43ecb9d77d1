"""The samples that a fit uses, and their weights."""

from __future__ import annotations

import numpy as np
from palpate import Flag, Floats, LastDigit, Samples
from palpate_kit.numerics.force_limit import at_limit
from palpate_kit.numerics.refusal import NotFitted

from palpate_fits.segments import Rows
from palpate_fits.unknowns import Unknowns

_SAMPLES_PER_UNKNOWN = 5  # (choice)
_MIN_SAMPLES = 10  # however few unknowns (choice)
_DEPTH_BINS = 50  # of the height, each of which counts the same (choice)
_SMALLEST_RANGE = 1e-300  # [m] in a quotient, in place of 0: near the smallest double


def refuse_few_samples(rows: Rows, unknowns: Unknowns) -> None:
    """Raise NotFitted where less than 5 samples for each unknown, or 10, are to be fitted."""
    count, minimum = np.count_nonzero(rows), max(_SAMPLES_PER_UNKNOWN * len(unknowns.free), _MIN_SAMPLES)
    if count < minimum:
        raise NotFitted("too-few-samples", f"{count} samples to fit; {minimum} are needed")


def without_saturation(samples: Samples, rows: Rows, notes: list[Flag]) -> Rows:
    """Return the fitted samples without those at the limit of the sensor, of which a note is appended."""
    limited = rows & at_limit(samples.force, samples.position, rows)
    if not limited.any():
        return rows
    top = float(samples.force[limited][0])
    text = f"the force stands at {top:.5g} N in {np.count_nonzero(limited)} samples, which are left out"
    notes.append(Flag("saturated", text))
    return np.asarray(rows & ~limited)


def digit_weights(force: Floats) -> Floats:
    """Return weights (n,) by which a plateau of equal readings (n,) [N] counts as one.

    All are 1 where the noise exceeds half a digit.
    """
    is_finite = np.isfinite(force)
    weight, digit = np.ones(len(force)), LastDigit.of(force[is_finite])
    if digit.exceeds_noise(force[is_finite]):
        weight[is_finite] = 1.0 / np.sqrt(digit.plateau_sizes(force[is_finite]))
    return weight


def depth_weights(height: Floats) -> Floats:
    """Return weights (n,) that make each of 50 bins of height count the same; their mean square is 1."""
    share = (height - height.min()) / max(float(np.ptp(height)), _SMALLEST_RANGE)
    bins = np.clip(share * _DEPTH_BINS, 0, _DEPTH_BINS - 1).astype(int)
    weight = 1.0 / np.sqrt(np.bincount(bins, minlength=_DEPTH_BINS)[bins])
    return np.asarray(weight / np.sqrt(np.mean(weight**2)))
