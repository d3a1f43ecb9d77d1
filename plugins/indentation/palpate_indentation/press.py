"""One way into a material and out again, cut out of a record: heights, forces, and how noisy the force is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Floats, LogError, Samples, change_point

_TURN = 0.05  # of the way down; less of a way back is noise
_LEAST = 40  # samples on the way in
_SCALE = 1e-2  # [m]; the change point is looked for at the size of a palpation, whatever the record's
_LEAST_AIR = 10  # samples
_AIR_MARGIN = 0.02  # of the way before the change point that is left out of the air
_OFF = 6.0  # noise standard deviations
_IN_ALL = 5  # readings in a row
_WINDOW = 41  # samples of the local cubic for the rate


@dataclass(frozen=True)
class Branch:
    """One direction of the motion; heights [m] out of the material, forces [N], (n,)."""

    time: Floats
    height: Floats
    force: Floats
    rate: Floats  # (n,) [m/s] of the depth

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True)
class Press:
    """The way in with its air, and the way out where it was recorded."""

    approach: Branch
    retract: Branch | None
    air: int  # samples of the approach before contact, beyond doubt
    touch: float  # [m] where a change point sees contact begin
    noise: float  # [N] standard deviation of one reading


def press_of(samples: Samples, between: tuple[float, float] | None = None, name: str = "record") -> Press:
    """The first press of a record, or of a stretch of it [s]; raises LogError where there is none."""
    known = np.isfinite(samples.force) & np.isfinite(samples.position)
    if between is not None:
        known &= (samples.time >= between[0]) & (samples.time <= between[1])
    kept = samples[known]
    if len(kept) < _LEAST or np.ptp(kept.position) == 0 or np.ptp(kept.force) == 0:
        raise LogError(f"{name}: holds no press: {len(kept)} samples, or a height or force that never changes")
    begin, turn, end = _turns(kept.position)
    approach = _branch(kept[begin : turn + 1])
    if len(approach) < _LEAST:
        raise LogError(f"{name}: the way into the material has {len(approach)} samples, {_LEAST} are needed")
    retract = _branch(kept[turn : end + 1]) if end - turn >= _LEAST else None
    scale = _SCALE / float(np.ptp(approach.height))
    level = _level(approach)
    found = change_point(scale * approach.height, approach.force - level(approach.height))
    noise = _noise(approach.force)
    touch = found.surface / scale if found is not None else _first_off(approach, level(approach.height), noise)
    if touch is None:
        raise LogError(f"{name}: the force never rises out of its noise on the way in")
    margin = _AIR_MARGIN * float(np.ptp(approach.height))
    air = int(np.count_nonzero(np.cumsum(approach.height < touch + margin) == 0))
    if air < _LEAST_AIR:
        raise LogError(f"{name}: {air} samples of air before contact; without {_LEAST_AIR} there is no baseline")
    return Press(approach, retract, air, touch, noise)


def _first_off(branch: Branch, level: Floats, noise: float) -> float | None:
    """Height [m] from which on several readings in a row are off the level, up or, where the tip is drawn in, down."""
    off = np.abs(branch.force - level) > _OFF * noise
    rows = np.flatnonzero(np.convolve(off, np.ones(_IN_ALL), mode="valid") == _IN_ALL)
    return float(branch.height[rows[0]]) if len(rows) else None


def _turns(height: Floats) -> tuple[int, int, int]:
    """Begin of the way down, its deepest sample, and the end of the way out that follows."""
    reach = float(np.ptp(height))
    lowest = np.minimum.accumulate(height)
    up = np.flatnonzero((height - lowest > _TURN * reach) & (height.max() - lowest > 0.5 * reach))
    until = int(up[0]) + 1 if len(up) else len(height)
    turn = int(np.argmin(height[:until]))
    begin = int(np.argmax(height[: turn + 1]))
    out = height[turn:]
    down = np.flatnonzero(np.maximum.accumulate(out) - out > _TURN * reach)
    last = int(down[0]) + 1 if len(down) else len(out)
    return begin, turn, turn + int(np.argmax(out[:last]))


def _branch(samples: Samples) -> Branch:
    from scipy.signal import savgol_filter

    count = len(samples)
    if count < 7:
        return Branch(samples.time, samples.position, samples.force, np.zeros(count))
    width = min(_WINDOW, (count - 1) // 2 * 2 + 1)
    interval = float(np.median(np.diff(samples.time)))
    rate = -savgol_filter(samples.position, width, 3, deriv=1, delta=interval)
    return Branch(samples.time, samples.position, samples.force, np.asarray(rate, float))


def _level(branch: Branch) -> np.poly1d:
    """Line through the first quarter of the way, which a tilted baseline makes the change point begin from."""
    top = branch.height > branch.height.max() - 0.25 * np.ptp(branch.height)
    found = np.polyfit(branch.height[top], branch.force[top], 1) if top.sum() > _LEAST_AIR else [0.0]
    return np.poly1d(found)


def _noise(values: Floats) -> float:
    """From third differences, in which slow motion drops out (white noise gives them 20 times its variance)."""
    third = np.diff(values, 3)
    return max(float(1.4826 * np.median(np.abs(third)) / np.sqrt(20.0)), 1e-300)
