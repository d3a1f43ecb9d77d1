"""A run of strokes that is stopped, watched from outside: its outcome, by the arm's states and the run's own report."""

from __future__ import annotations

import signal
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from palpate import DeviceError, Floats, clock

from palpate_commands.acceptance.job import StrokesJob
from palpate_commands.acceptance.measurement import (
    MissedError,
    first_beyond,
    measure_braking,
    measure_force_delay,
    measure_standstill,
)
from palpate_commands.acceptance.observer import Observer, StateAfterRun, state_after_run
from palpate_commands.acceptance.outcome import Allowed, Outcome
from palpate_commands.acceptance.steps import Visit
from palpate_commands.acceptance.watched_arm import WatchedArm

# Choices.
POLL_INTERVAL = 0.004  # [s] between two looks at the arm: two states of one at 500 Hz
REST_TIMEOUT = 10.0  # [s] for an arm to come to rest, and for a run to end


@dataclass(frozen=True)
class WatchedRun:
    """A run of strokes for a step at a site, with what watches it."""

    visit: Visit
    allowed: Allowed
    arm: WatchedArm
    stiffness: float  # [N/m] of the stiffest material that [safety] declares
    observer: Observer
    job: StrokesJob
    origin: int  # [ns] of all times

    @property
    def tip_speed(self) -> float:
        """Speed [m/s] of the tip by that of the strokes, which an arm on a spring does not reach in the material.

        A tip on a spring k [N/m] goes k/(k + K) of its command's way into a material of K [N/m].
        """
        spring = getattr(self.arm.device, "controller_stiffness", None)
        if self.visit.site == "free-air" or spring is None:
            return self.job.run.strokes.speed
        return self.job.run.strokes.speed * float(spring / (spring + self.stiffness))

    def outcome(self, event: float | None, seed: int) -> Outcome:
        """Return the outcome of a run that has been stopped by an event at a time [s], or of strokes that ended.

        Without a time the event is the one that robot or sensor report. `seed` is that of a connection that is made
        again. Raises MissedError where the record shows no stop.
        """
        trace = self.observer.trace(self.origin)
        if not self.visit.step.stops:
            if stop := self.job.run.live_facts.get("stop"):
                raise MissedError(stop["reason"])
            delay = measure_force_delay(trace, *self._tared_readings())
            report = self._stop_reason or "it came to its end"
            return Outcome(self.visit, self.allowed, None, report, delay, self._answers)
        event = self.event_time() if event is None else event
        state_after = self._state_after(seed)
        report = "; ".join(filter(None, (self._stop_reason, self._place(state_after))))
        if state_after is not None and self.visit.step.number == signal.SIGKILL:
            standstill = measure_standstill(trace, event, self.tip_speed, state_after.height, state_after.movement)
            return Outcome(self.visit, self.allowed, None, report, standstill=standstill)
        braking = measure_braking(trace, event, self.tip_speed, self.visit.step.leaves)
        return Outcome(self.visit, self.allowed, braking, report, answers=self._answers)

    def event_time(self) -> float:
        """Return the time [s] of an event, as the robot or the sensor report it; raises MissedError."""
        step, max_force = self.visit.step, self.job.run.stop_force
        if step.mode:
            return self.observer.mode_change(self.origin, step.mode)
        if max_force is None:  # the sensor's cable: its last reading
            return float(self._readings()[0][-1])
        try:
            return first_beyond(*self._tared_readings(), max_force)
        except MissedError as error:
            raise MissedError(f"{error}: {self._stop_reason}") from error

    def refusal(self) -> Exception:
        """Return the error of a run that ended before it was stopped: a DeviceError if it never moved."""
        run = self.job.run
        if run.live_facts.get("stop") is None and run.message:
            return DeviceError(f"the run of the strokes did not begin: {run.message} ({run.folder})")
        return MissedError(run.message or "the strokes came to their end, and nothing had stopped them")

    def _state_after(self, seed: int) -> StateAfterRun | None:
        """Return the arm's state by a connection after a run that could not record all of its states, else None."""
        if not (self.arm.modes.single_connection and self.visit.step.interrupts_record):
            return None
        wait_until(lambda: not self.job.has_processes, REST_TIMEOUT)  # one of them has the connection
        return state_after_run(self.arm, seed)

    def _place(self, state: StateAfterRun | None) -> str:
        if state is None:
            return ""
        mode = f"{self.arm.modes.channel} {state.mode}"
        return f"connected to again, the tip is at {1e3 * state.height:.1f} mm, {mode}"

    @property
    def _answers(self) -> tuple[Mapping[str, float], ...]:
        """Answers of the arm to its first commands; none of a run that was killed."""
        devices: Mapping[str, Mapping[str, Any]] = self.job.run.live_facts.get("devices") or {}
        return tuple(devices.get(self.arm.name, {}).get("handshake", ()))

    @property
    def _stop_reason(self) -> str:
        """Reason that the run gave for its stop, else its message."""
        stop = self.job.run.live_facts.get("stop") or {}
        return str(stop.get("reason", "")) or self.job.run.message.partition("\n")[0]

    def _readings(self) -> tuple[Floats, Floats]:
        time, force = self.job.run.readings(self.origin)
        if not len(time):
            raise MissedError("the sensor sent no readings")
        return time, force

    def _tared_readings(self) -> tuple[Floats, Floats]:
        """Return times (n,) [s] and forces (n,) [N] less that at standstill; raises as `refusal` without one."""
        time, force = self._readings()
        standstill = self.job.run.live_facts.get("standstill")
        if standstill is None:
            raise self.refusal()
        return time, force - standstill["force"]


def wait_until(condition: Callable[[], bool], timeout: float, observer: Observer | None = None) -> None:
    """Wait for a condition; raises MissedError after a timeout [s], and where the observer has failed."""
    deadline = clock().now() + timeout
    while not condition():
        if observer is not None and observer.failure is not None:
            raise MissedError(observer.failure)
        if clock().now() > deadline:
            raise MissedError(f"nothing happened within {timeout:.0f} s")
        clock().sleep(POLL_INTERVAL)
