"""Hereditary integrals of a recorded history, and means of them over bins of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from palpate import Floats


def fading_integrals(values: Floats, time: Floats, times: Floats) -> Floats:
    """int exp(-(t - s)/tau_k) dx(s) (n, k) of values x (n,) at instants (n,) [s], for times tau (k,) [s].

    Exact for values that are straight lines between the instants and 0 before the first.
    """
    found = np.zeros((len(values), len(times)))
    turned = np.outer(np.diff(time), 1.0 / times)
    keep = np.exp(-turned)
    gain = -np.expm1(-turned) / np.maximum(turned, 1e-300) * np.diff(values)[:, None]
    state = np.full(len(times), float(values[0]))
    found[0] = state
    for i in range(len(keep)):
        state = keep[i] * state + gain[i]
        found[i + 1] = state
    return found


@dataclass(frozen=True)
class Bins:
    """Rows that are taken together, evenly over the logarithm of the time since a change."""

    begins: NDArray[np.int64]  # (m,) first row of each
    counts: NDArray[np.int64]  # (m,)

    def means(self, values: Floats) -> Floats:
        """Means (m, ...) of values (n, ...) over the rows of each bin."""
        end = int(self.begins[-1] + self.counts[-1])
        sums = np.add.reduceat(values[:end], self.begins, axis=0)
        return np.asarray(sums / (self.counts if values.ndim == 1 else self.counts[:, None]))

    @property
    def rows(self) -> NDArray[np.int64]:
        """The bin of every row from the first bin's first on."""
        return np.repeat(np.arange(len(self.begins)), self.counts)


def logarithmic(time: Floats, first: int, end: int, origin: float, per_decade: int, least: int = 1) -> Bins:
    """Bins of the rows from `first` to `end`, so many a decade of the time since an origin [s], of `least` rows."""
    place = np.floor(per_decade * np.log10(np.maximum(time[first:end] - origin, 1e-9))).astype(int)
    begins = np.concatenate([[0], np.flatnonzero(np.diff(place) != 0) + 1])
    kept = [0]
    for begin in begins[1:].tolist():
        if begin - kept[-1] >= least and end - first - begin >= least:
            kept.append(begin)
    begins = np.array(kept)
    counts = np.diff(np.append(begins, end - first))
    return Bins(first + begins, counts)
