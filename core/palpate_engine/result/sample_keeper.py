"""Samples of a whole record that are kept for diagnoses, in bounded memory."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from palpate.estimation import Estimates, Samples, Status
from palpate.evidence.sample_store import SampleStore
from palpate.vectors import Floats

# Choices: 65 536 samples of a track take 5 MB.
_BLOCK_SIZE = 4096  # samples that are kept or dropped together
_MAX_BLOCKS = 16  # of a track
_MAX_AIR = 4096  # samples before the first contact, and after the last
_COLUMNS = ("time", "force", "position", "velocity", "x", "y", "used", "surface", "innovation")


@dataclass
class Keeper:
    """Keeps samples of a record of any length in bounded memory; the same ones however they are cut into blocks."""

    _blocks: dict[int, Floats] = field(default_factory=dict)  # by number: (columns, 4096)
    _stride: int = 1  # of so many blocks one is kept
    _count: int = 0  # samples in contact so far
    _air_before: list[Floats] = field(default_factory=list)  # pieces (3, m): time, force, position
    _before_count: int = 0
    _air_after: list[Floats] = field(default_factory=list)  # the same of the samples since the last contact
    _after_count: int = 0

    def add(self, samples: Samples, estimates: Estimates) -> None:
        """Take in a block of samples with a track's estimates."""
        used = (estimates.status & Status.IDLE) == 0
        in_contact = samples.contact | used
        self._keep_air_before(samples, in_contact)
        self._keep_air_after(samples, in_contact)
        rows = np.flatnonzero(in_contact)
        if not len(rows):
            return
        measured = (samples.time, samples.force, samples.position, samples.velocity, *samples.lateral.T)
        columns = (*measured, used, estimates.surface, estimates.innovation)  # in the order of `_COLUMNS`
        # Block by block: of all blocks every `stride`-th is kept.
        while len(rows):
            number, place = divmod(self._count, _BLOCK_SIZE)
            batch, rows = rows[: _BLOCK_SIZE - place], rows[_BLOCK_SIZE - place :]
            if number % self._stride == 0 and number not in self._blocks:
                self._blocks[number] = np.empty((len(_COLUMNS), _BLOCK_SIZE))
                self._thin()
            if number in self._blocks:
                self._blocks[number][:, place : place + len(batch)] = [column[batch] for column in columns]
            self._count += len(batch)

    def _thin(self) -> None:
        """Drop every other block until no more than the limit are kept."""
        while len(self._blocks) > _MAX_BLOCKS:
            self._stride *= 2
            self._blocks = {number: block for number, block in self._blocks.items() if number % self._stride == 0}

    def _keep_air_before(self, samples: Samples, in_contact: NDArray[np.bool_]) -> None:
        """Keep free air before the first contact."""
        if self._count or self._before_count >= _MAX_AIR:
            return
        end = int(np.argmax(in_contact)) if in_contact.any() else len(in_contact)
        end = min(end, _MAX_AIR - self._before_count)
        self._air_before.append(_air_columns(samples, 0, end))
        self._before_count += end

    def _keep_air_after(self, samples: Samples, in_contact: NDArray[np.bool_]) -> None:
        """Keep air since the last contact."""
        begin = len(in_contact) - int(np.argmax(in_contact[::-1])) if in_contact.any() else 0
        if begin:
            self._air_after, self._after_count = [], 0
        if not self._count and not begin:
            return  # no contact yet
        end = min(len(in_contact), begin + _MAX_AIR - self._after_count)
        if end > begin:
            self._air_after.append(_air_columns(samples, begin, end))
            self._after_count += end - begin

    @property
    def kept(self) -> SampleStore:
        """Samples in contact that are kept so far."""
        # The last block may be unfinished.
        lengths = {number: min(self._count - number * _BLOCK_SIZE, _BLOCK_SIZE) for number in sorted(self._blocks)}
        pieces = [self._blocks[number][:, :length] for number, length in lengths.items()]
        table = np.concatenate(pieces, axis=1) if pieces else np.zeros((len(_COLUMNS), 0))
        indices = [np.arange(length) + number * _BLOCK_SIZE for number, length in lengths.items()]
        index = np.concatenate(indices) if indices else np.zeros(0, np.int64)
        time, force, position, velocity, x, y, used, surface, innovation = table
        lateral = np.column_stack([x, y])
        return SampleStore(
            index=index,
            time=time,
            force=force,
            position=position,
            velocity=velocity,
            lateral=lateral,
            used=used > 0.5,  # kept as 0 or 1
            surface=surface,
            innovation=innovation,
        )

    @property
    def air(self) -> Floats:
        """Time [s], force [N] and position [m] (3, a) before the first contact."""
        return np.concatenate(self._air_before, axis=1) if self._air_before else np.zeros((3, 0))

    @property
    def air_after(self) -> Floats:
        """The same (3, a) after the last contact."""
        return np.concatenate(self._air_after, axis=1) if self._air_after else np.zeros((3, 0))


def _air_columns(samples: Samples, begin: int, end: int) -> Floats:
    """Return time [s], force [N] and position [m] (3, m) of some samples."""
    return np.array([samples.time[begin:end], samples.force[begin:end], samples.position[begin:end]])
