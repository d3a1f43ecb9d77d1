"""One press from a recording: free air, a ramp, a hold, perhaps more of them, and free air again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import ContactModel, Flag, Floats, LogError
from palpate_kit.numerics.holds import Hold, holds_of

from palpate_spectra.first_touch import first_touch
from palpate_spectra.recorded_oscillation import ReplayedSamples
from palpate_spectra.reduced_area import reduced_area

# Choices.
_SMOOTHING_TIME = 0.02  # [s] of the local cubic for height and acceleration
_CUBIC = 3  # degree of the local polynomial
_MIN_WINDOW = 5  # [samples] of the local cubic, which has four coefficients
_MIN_AIR_SAMPLES = 50  # before the touch, and after the press, from which the force's zero is determined
_MIN_RAMP_SAMPLES = 5  # from the touch to a hold; what is held sooner is air
_AIR_BEFORE_TOUCH = 0.2  # [s] that belongs to the press
_AIR_CLEARANCE = 2e-4  # [m] above the touch, from which on the tip is in free air whatever the skin does
_MEAN_BLOCKS = 10  # by whose scatter the standard deviation of a mean is estimated, so that slow noise counts


@dataclass(frozen=True)
class RecordedPress:
    """A press from just before the touch to the end of its last hold."""

    name: str
    model: ContactModel
    time: Floats  # (n,) [s]
    force: Floats  # (n,) [N] of the contact: without inertia, and without offset and drift where the air shows them
    height: Floats  # (n,) [m] of the arm's tip, smoothed
    holds: tuple[Hold, ...]
    touch: float  # [m] height at the first sample in contact
    first_touch: tuple[float, float] | None  # [m] height of the first touch, and its tolerance; see `first_touch`
    offset_std: float  # [N] standard uncertainty of the force's zero
    drift: float | None  # [N] that was taken off, between the air before and after; None: no air after
    rig: Mapping[str, Any]  # as `ReplayedSamples` has it
    uncertainties: Mapping[str, Any]
    flags: tuple[Flag, ...]

    @property
    def longest_hold(self) -> Hold:
        """The hold of the most samples."""
        return max(self.holds, key=lambda hold: hold.end - hold.begin)

    def depth(self, surface: float, compliance: float) -> Floats:
        """Return the depth (n,) [m] of the tip under a surface [m], with arm and sensor of a compliance [m/N]."""
        return surface - self.height - compliance * self.force

    def area(self, surface: float, compliance: float) -> Floats:
        """Return the area A(d) c(d) (n,) [m^2] of the tip in the reduced plane (`reduced_area`)."""
        return reduced_area(self.model, self.depth(surface, compliance))


def longest_press(replayed: ReplayedSamples, name: str) -> RecordedPress:
    """Return the longest contact of a recording of a name, up to the end of its last hold.

    The force is freed of the tip's inertia, and of zero and drift by the air before and after. Raises LogError where
    the tip never touches, the record begins in contact, or nothing is held.
    """
    samples = replayed.samples[np.isfinite(replayed.samples.force) & np.isfinite(replayed.samples.position)]
    onset, contact_end = _longest_contact(samples.contact, name)
    interval = float(np.median(np.diff(samples.time)))
    first = max(onset - round(_AIR_BEFORE_TOUCH / interval), 0)
    touch = float(samples.position[onset])

    height, acceleration = _smooth_motion(samples.position, interval)
    force = samples.force + float(replayed.rig["tip_mass"]) * acceleration
    air_before = np.flatnonzero(~samples.contact[:first])
    is_clear = ~samples.contact & (samples.position > touch + _AIR_CLEARANCE)
    air_after = contact_end + np.flatnonzero(is_clear[contact_end:])
    if len(air_before) < _MIN_AIR_SAMPLES:
        raise LogError(f"{name}: begins in contact, or nearly so; without its ramp a hold does not determine E(t)")
    zero, offset_std, drift = _force_zero(samples.time, force, air_before, air_after)
    contact_force = force - zero

    rows = slice(first, contact_end)
    # By the heights as they were read: of smoothed ones the noise, and so the band of what is held, would be too small.
    read_depth = np.maximum(touch - samples.position[rows], 0.0)
    holds = _holds_in_contact(samples.time[rows], read_depth, contact_force[rows], onset - first, name)
    end = holds[-1].end
    return RecordedPress(
        name=name,
        model=replayed.model,
        time=samples.time[rows][:end],
        force=contact_force[rows][:end],
        height=height[rows][:end],
        holds=tuple(holds),
        touch=touch,
        first_touch=first_touch(samples),
        offset_std=offset_std,
        drift=drift,
        rig=replayed.rig,
        uncertainties=replayed.uncertainties,
        flags=replayed.flags,
    )


def _longest_contact(contact: NDArray[np.bool_], name: str) -> tuple[int, int]:
    """Return the first row and the row after the last of the longest contact; raises LogError without a contact."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], contact.astype(np.int8), [0]])))
    if not len(edges):
        raise LogError(f"{name}: the tip never touches")
    begins, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - begins))
    return int(begins[longest]), int(ends[longest])


def _smooth_motion(position: Floats, interval: float) -> tuple[Floats, Floats]:
    """Return height (n,) [m] and acceleration (n,) [m/s^2] of positions at an interval [s], by local cubics."""
    from scipy.signal import savgol_filter

    window = max(2 * round(_SMOOTHING_TIME / interval / 2) + 1, _MIN_WINDOW)
    height = savgol_filter(position, window, _CUBIC)
    acceleration = savgol_filter(position, window, _CUBIC, deriv=2, delta=interval)
    return np.asarray(height, np.float64), np.asarray(acceleration, np.float64)


def _holds_in_contact(time: Floats, depth: Floats, force: Floats, onset: int, name: str) -> list[Hold]:
    """Return the holds of a press (n,) after the row of its touch; raises LogError where nothing is held.

    A creep is a single hold, however often the force has left its band.
    """
    # Air before the touch is steady, too.
    holds = [hold for hold in holds_of(time, depth, force) if hold.begin >= onset + _MIN_RAMP_SAMPLES]
    if not holds:
        raise LogError(f"{name}: nothing is held: neither depth nor force is steady for half a second in contact")
    if holds[0].kind == "creep":
        return [Hold("creep", holds[0].begin, holds[-1].end)]
    return holds


def _force_zero(
    time: Floats, force: Floats, air_before: NDArray[np.int64], air_after: NDArray[np.int64]
) -> tuple[Floats, float, float | None]:
    """Return the force's zero (n,) [N], its standard uncertainty [N], and its drift [N] from one air to the other.

    `air_before` and `air_after` are the rows of free air before and after the contact. The zero is a straight line
    through both means; with too little air after the contact it is the mean before, and the drift None.
    """
    mean_before, std_before = _mean_with_std(force[air_before])
    if len(air_after) < _MIN_AIR_SAMPLES:
        return np.full(len(time), mean_before), std_before, None
    mean_after, std_after = _mean_with_std(force[air_after])
    time_before, time_after = float(time[air_before].mean()), float(time[air_after].mean())
    drift = mean_after - mean_before
    zero = mean_before + drift * (time - time_before) / (time_after - time_before)
    root_mean_square_std = float(np.hypot(std_before, std_after) / 2**0.5)
    return zero, root_mean_square_std, drift


def _mean_with_std(values: Floats) -> tuple[float, float]:
    """Return the mean of values (n,) and its standard deviation, by the scatter of the means of ten blocks."""
    block_means = [float(block.mean()) for block in np.array_split(values, _MEAN_BLOCKS)]
    return float(values.mean()), float(np.std(block_means, ddof=1) / np.sqrt(_MEAN_BLOCKS))
