"""Tare and touch: what the sensor reads in free air, and when the tip is in contact."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.alignment.settings import AlignmentSettings
from palpate.errors import LogError
from palpate.estimation import Samples

GRAVITY = 9.80665  # [m/s^2], standard
_PAPER_NOISE = 0.05  # [N], standard deviation of the sensor in the paper; where there is no free air to measure it in
_TOUCH_SIGMAS = 5.0
_LEAST_TOUCH = 0.05  # [N]; a sensor without noise still feels the tip's inertia
_AIR_SAMPLES = 50  # before the first touch, to tell whether the force is none there
_WANDER = 0.02  # [N]; less is drift
_IN_A_ROW = 3  # samples that must agree before contact is found or lost


@dataclass(frozen=True)
class Tare:
    """What was subtracted from the force, and how noisy the force was there."""

    offset: float  # [N]
    offset_std: float | None  # [N] standard uncertainty of the offset, from the scatter; None where none was measured
    noise: float | None  # [N] standard deviation of one sample in free air


class TouchFinder:
    """Takes raw force to tared force and marks the samples in contact; holds samples back until the tare is known."""

    def __init__(self, settings: AlignmentSettings) -> None:
        self._settings = settings
        self._waiting: list[Samples] = []
        self.tare: Tare | None = None
        self.first_touch: tuple[float, float] | None = None  # time [s], position [m]
        self.touches = 0
        self._air_sum, self._air_count = 0.0, 0
        self._in_contact = False
        self._above = self._below = 0

    @property
    def threshold(self) -> float:
        """Force [N] that counts as touch."""
        if self._settings.touch_force is not None:
            return self._settings.touch_force
        noise = self.tare.noise if self.tare and self.tare.noise else _PAPER_NOISE
        return max(_TOUCH_SIGMAS * noise, _LEAST_TOUCH)

    def run(self, samples: Samples, final: bool = False) -> Samples:
        """The samples that can be told to be in contact or not; all that are left where `final`."""
        if self.tare is None:
            self._waiting.append(samples)
            samples = Samples.joined(self._waiting)
            free_air = self._settings.tare == "free-air"
            if free_air and not final and not (len(samples) and samples.time[-1] > self._settings.tare_duration):
                self._waiting = [samples]
                return samples[:0]
            self._waiting = []
            self.tare = self._measure(samples)
        return self._mark(samples) if len(samples) else samples

    def _measure(self, samples: Samples) -> Tare:
        if self._settings.tare == "none":
            return Tare(0.0, None, None)
        if self._settings.tare != "free-air":
            return Tare(float(self._settings.tare), self._settings.tare_uncertainty, None)
        window = samples.force[samples.time <= self._settings.tare_duration]
        window = window[np.isfinite(window)]
        if len(window) < 10:
            return Tare(0.0, None, None)
        spread = float(window.std(ddof=1))
        if not _at_rest(window):
            raise LogError(
                f"alignment: the first {self._settings.tare_duration:g} s of {self._settings.force.channel} are not at "
                f"rest in free air (the force wanders by {spread:.2g} N), so they give no tare; set [alignment] tare = "
                '"none", a force, or a shorter tare_duration'
            )
        return Tare(float(window.mean()), spread / np.sqrt(len(window)), spread)

    def _mark(self, samples: Samples) -> Samples:
        assert self.tare is not None
        force = samples.force - self.tare.offset
        if self._settings.weight == "removed" and self._settings.tip_mass is not None:
            force = force + self._settings.tip_mass * GRAVITY
        contact = self._contact(force)
        self._listen_to_the_air(force[~np.logical_or.accumulate(contact)])
        begins = contact & ~np.concatenate([[self._in_contact], contact[:-1]])
        if self.first_touch is None and begins.any():
            first = int(np.argmax(begins))
            self.first_touch = float(samples.time[first]), float(samples.position[first])
        self.touches += int(np.count_nonzero(begins))
        self._in_contact = bool(contact[-1])
        return replace(samples, force=force, contact=contact, active=contact & samples.active)

    def _listen_to_the_air(self, force: NDArray[np.float64]) -> None:
        """What the force is before the first touch, where it should be none."""
        if self.first_touch is None:
            known = force[np.isfinite(force)]
            self._air_sum += float(known.sum())
            self._air_count += len(known)

    @property
    def air_force(self) -> float | None:
        """Mean force [N] before the first touch; None where there is too little of that."""
        return self._air_sum / self._air_count if self._air_count >= _AIR_SAMPLES else None

    def _contact(self, force: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Hysteresis: on after some samples in a row above the threshold, off after as many below half of it."""
        above = _in_a_row(force > self.threshold, self._above)
        below = _in_a_row(force < 0.5 * self.threshold, self._below)
        self._above, self._below = int(above[-1]), int(below[-1])
        event = np.where(above >= _IN_A_ROW, 1, np.where(below >= _IN_A_ROW, -1, 0))
        event = np.concatenate([[1 if self._in_contact else -1], event])
        latest = np.maximum.accumulate(np.where(event != 0, np.arange(len(event)), 0))
        contact: NDArray[np.bool_] = event[latest][1:] > 0
        return contact


def _in_a_row(condition: NDArray[np.bool_], before: int) -> NDArray[np.int64]:
    """How many samples up to each one meet a condition without interruption, `before` of them in the last block."""
    index = np.arange(len(condition))
    broken = np.maximum.accumulate(np.where(condition, -1, index))
    return np.where(broken < 0, index + 1 + before, index - broken)


def _at_rest(force: NDArray[np.float64]) -> bool:
    """Whether a record scatters within its sixths rather than wandering from one to the next."""
    parts = np.array_split(force, 6)
    between = float(np.std([part.mean() for part in parts]))
    within = float(np.mean([part.std() for part in parts]))
    return between <= _WANDER or between <= 1.5 * within
