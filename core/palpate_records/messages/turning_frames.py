"""Vectors in a frame that turns: their component along a direction of the fixed frame.

A quaternion q of a pose turns the tool's axes into those of the fixed frame. The component of a vector v, given in the
tool's frame, along a fixed direction n is n . R(q) v. Between two poses q is interpolated, linearly and normalised.
"""

from __future__ import annotations

import numpy as np
from palpate import Floats

from palpate_records.messages.topics import Stamps


def rotate_vectors(quaternions: Floats, vectors: Floats) -> Floats:
    """Return vectors (n, 3) rotated by unit quaternions (n, 4) in the order x, y, z, w.

    With the axis a, v + w c + a x c with c = 2 a x v.
    """
    axis = quaternions[:, :3]
    w = quaternions[:, 3:]
    cross = 2.0 * np.cross(axis, vectors)
    return vectors + w * cross + np.cross(axis, cross)


_MAX_LENGTH_ERROR = 1e-3  # of a quaternion that is an orientation: a choice


class FrameOrientations:
    """The orientations of a pose so far, and the readings that wait for later ones."""

    def __init__(self) -> None:
        self._stamps: Stamps = np.zeros(0, np.int64)
        self._quaternions: Floats = np.zeros((0, 4))
        self._waiting: list[tuple[Stamps, Stamps, Floats]] = []

    def learn(self, stamps: Stamps, quaternions: Floats) -> None:
        """Add orientations (n, 4) at stamps (n,) [ns], without those out of order or not of length 1."""
        length = np.sqrt((quaternions**2).sum(axis=1))
        latest = self._stamps[-1] if len(self._stamps) else np.iinfo(np.int64).min
        latest_before = np.maximum.accumulate(np.concatenate([[latest], stamps]))[:-1]
        is_valid = (np.abs(length - 1.0) < _MAX_LENGTH_ERROR) & (stamps > latest_before)
        self._stamps = np.concatenate([self._stamps, stamps[is_valid]])
        self._quaternions = np.concatenate([self._quaternions, quaternions[is_valid] / length[is_valid, None]])

    def add(self, stamps: Stamps, logged: Stamps, values: Floats) -> None:
        """Add readings (n, k) that wait for the orientations at their stamps (n,) [ns]."""
        self._waiting.append((stamps, logged, values))

    def ready(self, final: bool = False) -> list[tuple[Stamps, Stamps, Floats, Floats]]:
        """Remove and return blocks of readings with their orientations (n, 4), in their order.

        A block is time-stamps and log times (n,) [ns], values (n, k) and quaternions x, y, z, w (n, 4). They are those
        up to the latest orientation, or with `final` all; an orientation that is not known is NaN.
        """
        blocks = []
        while self._waiting:
            stamps, logged, values = self._waiting[0]
            if not final and not (len(self._stamps) and self._stamps[-1] >= stamps.max()):
                break
            blocks.append((stamps, logged, values, self._interpolate(stamps)))
            self._waiting.pop(0)
        if blocks:
            # Orientations before all waiting readings are dropped, but for the last of them.
            latest_done = int(blocks[-1][0].max())
            first_needed = min((int(stamps.min()) for stamps, _, _ in self._waiting), default=latest_done)
            first = max(int(np.searchsorted(self._stamps, first_needed, side="right")) - 1, 0)
            self._stamps = self._stamps[first:]
            self._quaternions = self._quaternions[first:]
        return blocks

    def _interpolate(self, stamps: Stamps) -> Floats:
        """Return the orientations (n, 4) at stamps (n,) [ns], linear between neighbours and normalised; NaN outside."""
        orientations = np.full((len(stamps), 4), np.nan)
        if not len(self._stamps):
            return orientations
        earlier_row = np.searchsorted(self._stamps, stamps, side="right") - 1
        is_inside = (earlier_row >= 0) & (stamps <= self._stamps[-1])
        earlier_row = earlier_row[is_inside]
        later_row = np.minimum(earlier_row + 1, len(self._stamps) - 1)
        earlier, later = self._quaternions[earlier_row], self._quaternions[later_row]
        later = np.where((earlier * later).sum(axis=1)[:, None] < 0, -later, later)  # q and -q are one orientation
        interval = np.maximum(self._stamps[later_row] - self._stamps[earlier_row], 1)
        weight = ((stamps[is_inside] - self._stamps[earlier_row]) / interval)[:, None]
        mean = earlier + weight * (later - earlier)
        orientations[is_inside] = mean / np.sqrt((mean**2).sum(axis=1))[:, None]
        return orientations
