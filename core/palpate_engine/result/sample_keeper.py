"""Keeps samples of a whole record for diagnoses, in bounded memory."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from palpate.estimation import Estimates, Samples, Status
from palpate.evidence.sample_store import SampleStore
from palpate.vectors import Floats

_BLOCK = 4096  # samples that are kept or dropped together
_MOST = 16  # blocks that are kept of a track
_AIR = 4096  # samples before the first contact, and after the last
_COLUMNS = ("time", "force", "position", "velocity", "x", "y", "used", "surface", "innovation")


@dataclass
class Keeper:
    """Keeps samples of a record of any length in bounded memory; the same ones however they are cut into blocks."""

    _blocks: dict[int, Floats] = field(default_factory=dict)  # by number: (columns, 4096)
    _every: int = 1  # of so many blocks one is kept
    _count: int = 0  # samples in contact so far
    _air: list[Floats] = field(default_factory=list)  # pieces (3, m): time, force, position
    _air_count: int = 0
    _after: list[Floats] = field(default_factory=list)  # the same of the samples since the last contact
    _after_count: int = 0

    def add(self, samples: Samples, estimates: Estimates) -> None:
        """Take in a block of samples with a track's estimates."""
        used = (estimates.status & Status.IDLE) == 0
        rows = samples.contact | used
        self._listen(samples, rows)
        self._follow(samples, rows)
        found = int(np.count_nonzero(rows))
        if not found:
            return
        measured = (samples.time, samples.force, samples.position, samples.velocity, *samples.lateral.T)
        columns = (*measured, used, estimates.surface, estimates.innovation)
        where, done = np.flatnonzero(rows), 0
        while done < found:
            block, place = divmod(self._count, _BLOCK)
            count = min(found - done, _BLOCK - place)
            if block % self._every == 0:
                if block not in self._blocks:
                    self._blocks[block] = np.empty((len(_COLUMNS), _BLOCK))
                    self._thin()
                if block in self._blocks:
                    taken = where[done : done + count]
                    self._blocks[block][:, place : place + count] = [column[taken] for column in columns]
            self._count, done = self._count + count, done + count

    def _thin(self) -> None:
        while len(self._blocks) > _MOST:
            self._every *= 2
            self._blocks = {block: table for block, table in self._blocks.items() if block % self._every == 0}

    def _listen(self, samples: Samples, rows: NDArray[np.bool_]) -> None:
        """Free air before the first contact."""
        if self._count or self._air_count >= _AIR:
            return
        until = min(int(np.argmax(rows)) if rows.any() else len(rows), _AIR - self._air_count)
        self._air.append(np.array([samples.time[:until], samples.force[:until], samples.position[:until]]))
        self._air_count += until

    def _follow(self, samples: Samples, rows: NDArray[np.bool_]) -> None:
        """Air since the last contact."""
        begin = len(rows) - int(np.argmax(rows[::-1])) if rows.any() else 0
        if begin:
            self._after, self._after_count = [], 0
        if not self._count and not begin:
            return  # no contact yet
        until = min(len(rows), begin + _AIR - self._after_count)
        if until > begin:
            self._after.append(
                np.array([samples.time[begin:until], samples.force[begin:until], samples.position[begin:until]])
            )
            self._after_count += until - begin

    @property
    def kept(self) -> SampleStore:
        """What is kept so far."""
        lengths = {block: min(self._count - block * _BLOCK, _BLOCK) for block in sorted(self._blocks)}
        pieces = [self._blocks[block][:, :length] for block, length in lengths.items()]
        table = np.concatenate(pieces, axis=1) if pieces else np.zeros((len(_COLUMNS), 0))
        indices = [np.arange(length) + block * _BLOCK for block, length in lengths.items()]
        index = np.concatenate(indices) if indices else np.zeros(0, np.int64)
        time, force, position, velocity, x, y, used, surface, innovation = table
        lateral = np.column_stack([x, y])
        return SampleStore(index, time, force, position, velocity, lateral, used > 0.5, surface, innovation)

    @property
    def air(self) -> Floats:
        """Time [s], force [N] and position [m] (3, a) before the first contact."""
        return np.concatenate(self._air, axis=1) if self._air else np.zeros((3, 0))

    @property
    def air_after(self) -> Floats:
        """The same (3, a) after the last contact."""
        return np.concatenate(self._after, axis=1) if self._after else np.zeros((3, 0))
