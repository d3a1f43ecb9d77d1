"""Vectors in a frame that turns: their component along a direction of the fixed frame.

A quaternion q of a pose turns the tool's axes into those of the fixed frame. The component of a vector v, given in the
tool's frame, along a fixed direction n is n . R(q) v. Between two poses q is interpolated, linearly and normalised.
"""

from __future__ import annotations

import numpy as np
from palpate import Floats

from palpate_records.messages.topics import Stamps


def rotate_vectors(quaternions: Floats, vectors: Floats) -> Floats:
    """(n, 3) vectors turned by unit quaternions (n, 4) in the order x, y, z, w."""
    axis, w = quaternions[:, :3], quaternions[:, 3:]
    cross = 2.0 * np.cross(axis, vectors)
    return vectors + w * cross + np.cross(axis, cross)


class FrameOrientations:
    """The orientations of a pose as they come, and the readings that wait for theirs."""

    def __init__(self) -> None:
        self._stamps: Stamps = np.zeros(0, np.int64)
        self._quaternions: Floats = np.zeros((0, 4))
        self._waiting: list[tuple[Stamps, Stamps, Floats]] = []

    def learn(self, stamps: Stamps, quaternions: Floats) -> None:
        """Take in orientations; those out of order or not of length 1 are left out."""
        length = np.sqrt((quaternions**2).sum(axis=1))
        latest = self._stamps[-1] if len(self._stamps) else np.iinfo(np.int64).min
        before = np.maximum.accumulate(np.concatenate([[latest], stamps]))[:-1]
        good = (np.abs(length - 1.0) < 1e-3) & (stamps > before)
        self._stamps = np.concatenate([self._stamps, stamps[good]])
        self._quaternions = np.concatenate([self._quaternions, quaternions[good] / length[good, None]])

    def add(self, stamps: Stamps, logged: Stamps, values: Floats) -> None:
        """Readings that wait."""
        self._waiting.append((stamps, logged, values))

    def ready(self, final: bool = False) -> list[tuple[Stamps, Stamps, Floats, Floats]]:
        """Blocks whose orientations (n, 4) are known, in their order; NaN where it is unknown even at the end."""
        found = []
        while self._waiting:
            stamps, logged, values = self._waiting[0]
            if not final and not (len(self._stamps) and self._stamps[-1] >= stamps.max()):
                break
            found.append((stamps, logged, values, self._at(stamps)))
            self._waiting.pop(0)
        if found:
            first = min((int(stamps.min()) for stamps, _, _ in self._waiting), default=int(found[-1][0].max()))
            old = max(int(np.searchsorted(self._stamps, first, side="right")) - 1, 0)
            self._stamps, self._quaternions = self._stamps[old:], self._quaternions[old:]
        return found

    def _at(self, stamps: Stamps) -> Floats:
        found = np.full((len(stamps), 4), np.nan)
        if not len(self._stamps):
            return found
        left = np.searchsorted(self._stamps, stamps, side="right") - 1
        inside = (left >= 0) & (stamps <= self._stamps[-1])
        left = left[inside]
        right = np.minimum(left + 1, len(self._stamps) - 1)
        one, other = self._quaternions[left], self._quaternions[right]
        other = np.where((one * other).sum(axis=1)[:, None] < 0, -other, other)  # q and -q are one orientation
        width = np.maximum(self._stamps[right] - self._stamps[left], 1)
        weight = ((stamps[inside] - self._stamps[left]) / width)[:, None]
        mixed = one + weight * (other - one)
        found[inside] = mixed / np.sqrt((mixed**2).sum(axis=1))[:, None]
        return found
