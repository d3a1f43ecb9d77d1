"""Palpation at a point by more than one frequency: several sines at once, or a chirp."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from palpate import Depth, Frequency, Length, Speed, Time
from pydantic import Field, model_validator

from palpate_trajectories.motion_parts import TOP_SPEED, PlannedMotion, Wave
from palpate_trajectories.nominal_height import NominalHeight
from palpate_trajectories.oscillation import ChirpPhase, Oscillation, together
from palpate_trajectories.planned_trajectory import PlannedTrajectory
from palpate_trajectories.smooth_profile import Knot, profile, rest_profile


class MultiSine(PlannedTrajectory):
    """Several sines at once around a depth: depth(t) = bias + sum_i A_i sin(2 pi f_i t).

    Several frequencies distinguish a delay between force and motion from viscosity, whose force grows with the
    frequency.
    """

    bias: Depth = Field(gt=0, description="depth around which the sines go, below the nominal surface")
    amplitudes: tuple[Length, ...] = Field(default=(5e-4, 3e-4, 2e-4), min_length=1, description="of the sines")
    frequencies: tuple[Frequency, ...] = Field(default=(0.5, 2.0, 5.0), min_length=1, description="of the sines")
    duration: Time = Field(default=10.0, gt=0, description="length of the measured part")
    clearance: Depth = Field(default=0.005, gt=0, description="height above the nominal surface at both ends")
    standstill: Time = Field(default=1.0, ge=0, description="standstill in free air before the approach, for the tare")
    speed: Speed = Field(default=0.01, gt=0, description="mean speed of approach and retraction")
    place: tuple[Length, Length] = Field(default=(0.0, 0.0), description="where [x, y]")
    surface: NominalHeight = Field(default=NominalHeight(), description="nominal surface")

    @model_validator(mode="after")
    def _check_motion(self) -> Any:
        if len(self.amplitudes) != len(self.frequencies):
            raise ValueError(f"{len(self.amplitudes)} amplitudes do not go with {len(self.frequencies)} frequencies")
        if min(*self.amplitudes, *self.frequencies) <= 0:
            raise ValueError("amplitudes and frequencies must be above 0")
        refuse_wave(together(self.amplitudes, self.frequencies), self.bias)
        return self

    @cached_property
    def _motion(self) -> PlannedMotion:
        return oscillating_motion(self, together(self.amplitudes, self.frequencies))


class Chirp(PlannedTrajectory):
    """A sine around a depth whose frequency goes exponentially from one value to another.

    depth(t) = bias + A sin(phi(t)), phi' = 2 pi f1 (f2/f1)^(t/T): every frequency gets the same number of periods.
    """

    bias: Depth = Field(gt=0, description="depth around which the sine goes, below the nominal surface")
    amplitude: Depth = Field(default=0.001, gt=0, description="amplitude of the sine")
    first_frequency: Frequency = Field(default=0.5, gt=0, description="frequency at the beginning")
    last_frequency: Frequency = Field(default=5.0, gt=0, description="frequency at the end")
    duration: Time = Field(default=10.0, gt=0, description="length of the measured part")
    clearance: Depth = Field(default=0.005, gt=0, description="height above the nominal surface at both ends")
    standstill: Time = Field(default=1.0, ge=0, description="standstill in free air before the approach, for the tare")
    speed: Speed = Field(default=0.01, gt=0, description="mean speed of approach and retraction")
    place: tuple[Length, Length] = Field(default=(0.0, 0.0), description="where [x, y]")
    surface: NominalHeight = Field(default=NominalHeight(), description="nominal surface")

    @model_validator(mode="after")
    def _check_motion(self) -> Any:
        if self.last_frequency * self.duration < 1:
            raise ValueError(f"duration {self.duration:g} s is shorter than one period of the last frequency")
        refuse_wave(self._wave, self.bias)
        return self

    @property
    def _wave(self) -> ChirpPhase:
        return ChirpPhase(self.amplitude, self.first_frequency, self.last_frequency, self.duration)

    @cached_property
    def _motion(self) -> PlannedMotion:
        return oscillating_motion(self, self._wave)


def refuse_wave(wave: Oscillation | ChirpPhase, bias: float) -> None:
    """Raise ValueError where an oscillation would leave the skin or is too fast."""
    if wave.reach >= bias:
        raise ValueError(f"the oscillation reaches {wave.reach:g} m and must stay below the bias of {bias:g} m")
    if wave.top_speed > TOP_SPEED:
        raise ValueError(f"the oscillation moves at up to {wave.top_speed:.3g} m/s, allowed {TOP_SPEED:g}")


def oscillating_motion(settings: MultiSine | Chirp, wave: Wave) -> PlannedMotion:
    """Return approach, oscillation and retraction as one motion."""
    # The depth goes to the bias and back, while the oscillation grows from nothing and fades. The way from the
    # clearance above the surface to the bias below it takes `transfer` [s].
    transfer = (settings.clearance + settings.bias) / settings.speed
    begin = settings.standstill + transfer
    end = begin + settings.duration
    times = (settings.standstill, begin, end, end + transfer)
    depths = (-settings.clearance, settings.bias, settings.bias, -settings.clearance)
    depth = profile([Knot(t, d) for t, d in zip(times, depths, strict=True)])
    swell = profile([Knot(t, s) for t, s in zip(times, (0.0, 1.0, 1.0, 0.0), strict=True)])
    x, y = (rest_profile(value) for value in settings.place)
    return PlannedMotion(
        duration=end + transfer,
        x=x,
        y=y,
        depth=depth,
        measuring=((begin, end),),
        surface=settings.surface,
        swell=swell,
        wave=wave,
        wave_start=begin,
    )
