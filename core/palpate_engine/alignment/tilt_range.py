"""Tilt: the range over which a tool turns against gravity in a record that takes its weight for constant."""

from __future__ import annotations

import math

import numpy as np
from palpate.device import Batch

from palpate_engine.alignment.ports import Port

_QUATERNION = ("qx", "qy", "qz", "qw")
_MAX_NORM_ERROR = (
    1e-3  # of the square of a quaternion, off 1: three digits of a log; beyond it is not a rotation: a choice
)


class TiltRange:
    """Range over time of cos(tilt), the z component of the tool's axis: 1 - 2 (x^2 + y^2) of a unit quaternion."""

    def __init__(self, position: Port) -> None:
        names = [channel.name for channel in position.stream.channels]
        has_orientation = position.stream.layout == "pose" and set(_QUATERNION) <= set(names)
        self._columns = [names.index(name) for name in _QUATERNION] if has_orientation else []
        self._low, self._high = math.inf, -math.inf

    def feed(self, batch: Batch) -> None:
        """Take in poses."""
        if not self._columns or not len(batch.time):
            return
        x, y, z, w = batch.values[:, self._columns].T
        unit = np.abs(x * x + y * y + z * z + w * w - 1.0) < _MAX_NORM_ERROR
        cosine = (1.0 - 2.0 * (x * x + y * y))[unit]
        if len(cosine):
            self._low, self._high = min(self._low, float(cosine.min())), max(self._high, float(cosine.max()))

    @property
    def width(self) -> float:
        """Width of the range; 0 where no orientation is known."""
        return max(self._high - self._low, 0.0)
