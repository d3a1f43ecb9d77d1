"""Aligner: joins the streams of the devices of a run into samples."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from palpate.alignment_report import AlignmentReport
from palpate.alignment_settings import AlignmentSettings
from palpate.device import Batch
from palpate.estimation import Samples
from palpate.vectors import Floats, read_only

from palpate_engine.alignment.contact_detector import ContactDetector
from palpate_engine.alignment.intake import Intake
from palpate_engine.alignment.ports import Ports
from palpate_engine.alignment.signal_reader import FixedToolReader, SignalReader, ToolSignals
from palpate_engine.alignment.turning_tool import TurningToolReader
from palpate_engine.alignment.velocity_lag import VelocityCheck

_SECOND = 1_000_000_000  # [ns]
_LATERAL = ("lateral_x", "lateral_y")


class Aligner:
    """Joins the streams of the devices; one for each run. A tip that is a sphere has a radius [m], any other has 0."""

    def __init__(
        self, settings: AlignmentSettings, ports: Ports, tip_radius: float = 0.0, most_mass: float = 0.0
    ) -> None:
        """Take settings and ports of a record, and of the tip the radius [m] and the largest possible mass [kg]."""
        self._settings = settings
        self._intake = Intake(ports, settings.gap)
        self._roles = self._intake.series
        self._contact = ContactDetector(settings, most_mass)
        self._check = VelocityCheck()
        self._origin: int | None = None
        self._previous: tuple[int, float] | None = None  # stamp [ns] and position [m] of the last instant served
        self._nothing: Samples | None = None  # a block without samples
        self._counts = {"samples": 0, "force": 0, "velocity": 0}  # all, without a force, and without a velocity
        self._reader: SignalReader = (
            TurningToolReader(settings, ports["force"], self._roles, tip_radius)
            if settings.is_oriented
            else FixedToolReader(ports, self._roles, settings.beam)
        )

    def feed(self, device: str, batch: Batch) -> None:
        """Take in the readings of one of a device's streams."""
        self._intake.feed(device, batch)
        self._reader.feed(device, batch)

    def aligned(self, arrivals: Iterable[tuple[str, Batch]], final: bool = False) -> Samples:
        """Return the samples that some batches, each with its device, have made ready."""
        for device, batch in arrivals:
            self.feed(device, batch)
        return self.samples(final)

    def samples(self, final: bool = False) -> Samples:
        """Return the samples that have become ready, read-only; with `final`, all that the record still holds."""
        block = self._paired(final)
        if not len(block) and not final:
            return block
        if "velocity" in self._roles and len(block):
            self._check.feed(block)
        samples = read_only(self._contact.feed(block, final))
        self._reader.release(samples.contact)
        return samples

    def _paired(self, final: bool) -> Samples:
        """Return the samples at the positions up to which every other signal has a reading; with `final` at all of
        them.

        Force, and what else is read, is interpolated at the stamps of the position.
        """
        base = self._roles["position"]
        other_series = [series for role, series in self._roles.items() if role != "position"]
        # Up to the latest stamp that every signal has reached; -1 before the first reading of one.
        horizon = min((-1 if series.last is None else series.last for series in (base, *other_series)), default=-1)
        count = int(np.searchsorted(base.stamps, horizon, side="right"))
        if "velocity" not in self._roles and not final:
            # A central difference needs the next position, too, and behind a beam the force at it.
            count = count - 1 if self._settings.beam is not None else min(count, len(base.stamps) - 1)
        count = max(count, 0)
        if self._origin is None and count:
            # No sample comes before the first reading of every signal.
            skipped = int(np.searchsorted(base.stamps[:count], max(int(series.stamps[0]) for series in other_series)))
            base.drop(skipped)
            count -= skipped
        if not count and self._nothing is not None:  # as after most batches, where each stream has its own
            return self._nothing
        # The position after the block serves its last difference, and stays for the next block.
        stamps = base.stamps[: count + 1]
        signals = self._reader.read(stamps, count)
        block = self._block(stamps, count, signals)
        if not count:
            self._nothing = block
        else:
            self._previous = int(block.stamp[-1]), float(block.position[-1])
            base.drop(count)
            for series in other_series:
                series.forget_before(self._previous[0])
        return block

    def _block(self, next_stamps: NDArray[np.int64], count: int, signals: ToolSignals) -> Samples:
        """Return a block of samples at the first `count` stamps (n,) [ns], the next one for differences.

        `signals` are force, height and velocity there, and the curvature of the skin. Contact is not judged yet.
        """
        stamps, force, velocity = next_stamps[:count], signals.force, signals.velocity
        if self._origin is None and count:
            self._origin = int(stamps[0])
        if velocity is None:
            velocity = self._central_difference(next_stamps, signals.height)[:count]
        # A signal of 0 and 1 that is interpolated counts as 1 from the middle on.
        measuring = np.ones(len(stamps), bool)
        if "measuring" in self._roles:
            measuring = self._roles["measuring"].at(stamps) > 0.5
        previous_stamp = stamps[:1] if self._previous is None else np.array([self._previous[0]])
        # The interval of a sample is the time since the one before; 0 of the first of a record.
        interval = np.diff(np.concatenate([previous_stamp, stamps])) / _SECOND if len(stamps) else np.zeros(0)
        self._counts["samples"] += len(stamps)
        self._counts["force"] += int(np.count_nonzero(np.isnan(force)))
        self._counts["velocity"] += int(np.count_nonzero(np.isnan(velocity)))
        time = (stamps - (self._origin or 0)) / _SECOND
        contact = np.zeros(len(stamps), bool)
        # Of a sweep one coordinate is enough: the other one stays at 0.
        unread_column = np.full(len(stamps), 0.0 if any(role in self._roles for role in _LATERAL) else np.nan)
        lateral = [self._roles[role].at(stamps) if role in self._roles else unread_column for role in _LATERAL]
        return Samples(
            stamp=stamps,
            time=time,
            interval=interval,
            force=force,
            position=signals.height[:count],
            velocity=velocity,
            contact=contact,
            active=measuring,
            lateral=np.column_stack(lateral),
            curvature=signals.curvature,
        )

    def _central_difference(self, stamps: NDArray[np.int64], position: Floats) -> Floats:
        """Return the velocity (n,) [m/s] at stamps (n,) [ns]; NaN at an end and next to a gap.

        It is the slope at the middle of the parabola through three neighbours, which has no delay: (s2 h1 + s1 h2)/(h1
        + h2) of the slopes s1, s2 over the steps h1, h2 before and after.
        """
        if self._previous is not None:
            stamps = np.concatenate([[self._previous[0]], stamps])
            position = np.concatenate([[self._previous[1]], position])
        velocity = np.full(len(stamps), np.nan)
        if len(stamps) > 2:
            width = np.diff(stamps)
            step = width / _SECOND
            slope = np.diff(position) / step
            slope[width > self._roles["position"].gap] = np.nan
            velocity[1:-1] = (slope[1:] * step[:-1] + slope[:-1] * step[1:]) / (step[1:] + step[:-1])
        return velocity[1:] if self._previous is not None else velocity

    @property
    def reached(self) -> float:
        """Time [s] that the record has been joined up to; samples may still be held back."""
        if self._previous is None or self._origin is None:
            return 0.0
        return (self._previous[0] - self._origin) / _SECOND

    @property
    def report(self) -> AlignmentReport:
        """Return the evidence of the record so far."""
        contact, counts = self._contact, self._counts
        streams = {".".join(part for part in key if part): health for key, health in self._intake.health.items()}
        tool = self._reader.report
        return AlignmentReport(
            streams=streams,
            tare=contact.tare,
            touch_force=contact.threshold.force,
            first_touch=contact.first_touch,
            touches=contact.touches,
            air_force=contact.air_force,
            samples=counts["samples"],
            missing_force=counts["force"],
            missing_velocity=counts["velocity"],
            duration=self.reached,
            velocity_delay=self._check.delay,
            by_change_point=contact.by_change_point,
            pull=contact.pull,
            sideways=tool.sideways,
            turned=tool.turned,
            tilt=tool.tilt,
            velocity_share=self._check.share,
        )
