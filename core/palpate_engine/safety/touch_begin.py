"""Begin of a touch: how the force rises over its first 0.3 mm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from palpate.sound_force import SoundForce

_HALF = 0.15e-3  # [m]; two of them are compared (0470)
_MIN_READINGS = 4  # of each half: a choice
_MIN_TOUCHES = 8  # of which one is compared with the others (0470)
_FALSE = 0.01  # share of sound maps that get a note (0470)
_TESTS = 4  # of a touch: slope and shape, each to both sides


@dataclass(frozen=True)
class TouchSlope:
    """Slope and shape of the force over the first 0.3 mm of a touch."""

    place: tuple[float, ...]  # (3,) [m]
    slope: float  # [N/m] from the mean of the first half to that of the second
    shape: float  # ratio of the first mean to the second
    std: float  # [N/m] of the slope, by the noise


class TouchBegin:
    """Collects the force over the first 0.3 mm past the place of the first contact."""

    def __init__(self, place: Sequence[float], foot: float) -> None:
        self._place, self._foot = tuple(place), foot
        self._counts, self._sums = [0, 0], [0.0, 0.0]
        self._deepest = foot

    def add(self, way: float, count: int, total: float) -> bool:
        """Add readings, so many with a sum [N], at a way [m] inwards; return True where no more are needed."""
        depth = way - self._foot
        self._deepest = max(self._deepest, way)
        if depth > 2 * _HALF or way < self._deepest - _HALF:
            return True
        half = int(depth > _HALF)
        self._counts[half] += count
        self._sums[half] += total
        return False

    def slopes(self, sound: SoundForce) -> list[TouchSlope]:
        """Return slope and shape; an empty list of a touch that was too short or too fast."""
        if min(self._counts) < _MIN_READINGS:
            return []
        first, second = (total / count for total, count in zip(self._sums, self._counts, strict=True))
        error = math.hypot(*(sound.standard_error(count) for count in self._counts))
        return [TouchSlope(self._place, (second - first) / _HALF, first / second if second else 0.0, error / _HALF)]


def touch_outlier_text(touches: Sequence[TouchSlope]) -> str | None:
    """Return the place of a touch whose slope or shape is not among the others', and what differs; None of none.

    A touch is compared with a prediction interval from the others (Student's t), which 1 % of sound maps exceed. The
    place is by x and y.
    """
    if len(touches) < _MIN_TOUCHES:
        return None
    from scipy.stats import t

    # Prediction interval of one value from n - 1 others: t s sqrt(1 + 1/(n - 1)), with all touches tested (Bonferroni).
    factor = float(t.isf(_FALSE / (_TESTS * len(touches)), len(touches) - 2)) * math.sqrt(
        1.0 + 1.0 / (len(touches) - 1)
    )
    texts = []
    for number, touch in enumerate(touches):
        other_touches = [*touches[:number], *touches[number + 1 :]]
        slope, scatter = _mean_and_scatter([other.slope for other in other_touches])
        shape, spread = _mean_and_scatter([other.shape for other in other_touches])
        place = ", ".join(f"{1e3 * x:.1f}" for x in touch.place[:2])
        if abs(touch.slope - slope) > factor * scatter:
            difference = f"{1e-3 * touch.slope:.2f} N/mm in place of {1e-3 * slope:.2f}"
        elif abs(touch.shape - shape) > factor * spread:
            difference = f"by {touch.shape:.2f} of it within the first half, in place of {shape:.2f}"
        else:
            continue
        texts.append(f"at ({place}) mm the force rises otherwise over its first 0.3 mm: {difference}")
    if not texts:
        return None
    further = f"; so do {len(texts) - 1} more" if len(texts) > 1 else ""
    return f"of {len(touches)} touches that {texts[0]}{further}"


def _mean_and_scatter(values: Sequence[float]) -> tuple[float, float]:
    """Return mean and standard deviation."""
    mean = sum(values) / len(values)
    return mean, math.sqrt(sum((value - mean) ** 2 for value in values) / (len(values) - 1))
