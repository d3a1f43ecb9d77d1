"""Hereditary integrals of a recorded history, and means of them over bins of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

# Choices, so that a division and a logarithm stay finite.
_MIN_SHARE = 1e-300  # of a relaxation time in a sample
_MIN_AGE = 1e-9  # [s] since the origin of logarithmic bins


def fading_integrals(values: Floats, time: Floats, relaxation_times: Floats) -> Floats:
    """Return int exp(-(t - s)/tau_k) dx(s) (n, k) of values x (n,) at instants t (n,) [s], for times tau (k,) [s].

    Exact for values that are straight lines between the instants and 0 before the first: over an interval T the
    integral fades by exp(-T/tau) and gains dx (1 - exp(-T/tau)) tau/T.
    """
    integrals = np.zeros((len(values), len(relaxation_times)))
    share = np.outer(np.diff(time), 1.0 / relaxation_times)  # T/tau
    fading = np.exp(-share)
    gain = -np.expm1(-share) / np.maximum(share, _MIN_SHARE) * np.diff(values)[:, None]
    integral = np.full(len(relaxation_times), float(values[0]))
    integrals[0] = integral
    for i in range(len(fading)):
        integral = fading[i] * integral + gain[i]
        integrals[i + 1] = integral
    return integrals


@dataclass(frozen=True)
class Bins:
    """Stretches of rows, one after another, over each of which a mean is taken."""

    begins: NDArray[np.int64]  # (m,) first row of each
    counts: NDArray[np.int64]  # (m,) rows of each

    def means(self, values: Floats) -> Floats:
        """Return the means (m, ...) of values (n, ...) over the rows of each bin."""
        end = int(self.begins[-1] + self.counts[-1])
        sums = np.add.reduceat(values[:end], self.begins, axis=0)
        return np.asarray(sums / (self.counts if values.ndim == 1 else self.counts[:, None]))


def logarithmic_bins(time: Floats, first: int, end: int, *, origin: float, per_decade: int, min_rows: int = 1) -> Bins:
    """Return bins of the rows `first` to `end` - 1, so many a decade of the time since an origin [s].

    A bin of fewer than `min_rows` rows is joined to the one before.
    """
    age = np.maximum(time[first:end] - origin, _MIN_AGE)
    bin_number = np.floor(per_decade * np.log10(age)).astype(int)
    candidates = np.concatenate([[0], np.flatnonzero(np.diff(bin_number) != 0) + 1])
    begins = [0]
    for candidate in candidates[1:].tolist():
        if candidate - begins[-1] >= min_rows and end - first - candidate >= min_rows:
            begins.append(candidate)
    counts = np.diff(np.append(begins, end - first))
    return Bins(first + np.array(begins), counts)
