"""A filter's output at every sample, for a smoother: the latest is kept, the rest recomputed on demand."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from palpate import Floats

from palpate_filters.recursion import ActiveStretch

_MAX_STRETCHES = 32  # a choice: of 2000 samples with ten states each, 64 MiB


class OutputStore:
    """Outputs of stretches, in bounded memory: those that were used last are kept.

    A state with its covariance takes a kilobyte a sample, ten times the estimates of it. A stretch keeps the state
    that it began with, so that the filter runs over it once more and gives the same bits; a smoother goes back once,
    so that this costs at most another pass.
    """

    def __init__(self, capacity: int = _MAX_STRETCHES) -> None:
        self._capacity = capacity
        self._kept: OrderedDict[int, tuple[ActiveStretch, Floats]] = OrderedDict()

    def keep(self, stretch: ActiveStretch, outputs: Floats) -> None:
        """Keep the outputs (m, ny) of a stretch."""
        self._kept[id(stretch)] = stretch, outputs  # which holds it, so that no other has its id
        if len(self._kept) > self._capacity:
            self._kept.popitem(last=False)

    def of(self, stretch: ActiveStretch) -> Floats:
        """Return the outputs (m, ny) of a stretch, computed again where they are not kept."""
        if id(stretch) in self._kept:
            self._kept.move_to_end(id(stretch))
        else:
            self.keep(stretch, stretch.again()[1])
        return self._kept[id(stretch)][1]

    def forget(self) -> None:
        """Drop all outputs."""
        self._kept.clear()


class FilteredRows:
    """Rows of the outputs of stretches, one after the other."""

    def __init__(self, stretches: Sequence[ActiveStretch], kept: OutputStore) -> None:
        self._stretches, self._kept = stretches, kept
        self._begins = np.cumsum([0, *(len(stretch.interval) for stretch in stretches)]).tolist()

    def of(self, first: int, last: int, columns: slice) -> Floats:
        """Return some columns of the rows from first to last, the last excluded."""
        bounds = zip(self._stretches, pairwise(self._begins), strict=True)
        pieces = [
            self._kept.of(stretch)[max(first - begin, 0) : last - begin, columns]
            for stretch, (begin, end) in bounds
            if begin < last and first < end
        ]
        return pieces[0] if len(pieces) == 1 else np.concatenate(pieces)
