"""An acceptance protocol at work: one stop after the other, each watched from outside the run that is stopped."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from palpate import ConfigurationError, DeviceError, Floats, clock, host_time_ns
from palpate_engine import Pipeline, SafetySettings, check_own_motion, own_motions

from palpate_commands.acceptance.job import StrokesJob
from palpate_commands.acceptance.measurement import (
    MissedError,
    first_beyond,
    measure_braking,
    measure_force_delay,
    measure_standstill,
)
from palpate_commands.acceptance.observer import Observer, StateAfterRun, observed_run, state_after_run
from palpate_commands.acceptance.outcome import STANDSTILL_MOVEMENT, Allowed, Outcome
from palpate_commands.acceptance.steps import AcceptanceStep, Visit
from palpate_commands.acceptance.strokes import Strokes, demand_limits, plan_strokes, strokes_pipeline
from palpate_commands.acceptance.strokes_run import StrokesRun
from palpate_commands.acceptance.watched_arm import WatchedArm

_LOOK = 0.004  # [s]
_ATTEMPTS = 4
_START = 60.0  # [s] until a run moves
_REST = 0.5  # [s] without motion after which the arm stands
_LONGEST = 10.0  # [s] for an arm to come to rest
_MARGIN = 0.25  # [s] of straight way beyond the time that is allowed, where there is so much
_LATE = 0.2  # [s] of states, with which no stroke can be hit
_STEADY = 0.75  # of the speed of the strokes: on a busy computer they are slower


@dataclass(frozen=True)
class AcceptanceGuide:
    """Who leads a person through the protocol."""

    say: Callable[[str], None]
    ask: Callable[[str], None]  # returns when it is done
    act: Callable[[AcceptanceStep], None] = lambda step: None  # what a twin does for a person, on the way down


class AcceptanceProtocol:
    """The steps on one rig."""

    def __init__(
        self,
        pipeline: Pipeline,
        folder: Path,
        guide: AcceptanceGuide,
        start: Callable[[StrokesRun], StrokesJob],
        stop_force: float | None = None,
    ) -> None:
        self._pipeline, self._folder, self._guide, self._start = pipeline, folder, guide, start
        self._limits = demand_limits(pipeline)
        self._arm = WatchedArm.of(pipeline)
        self._stop_force = self._limits.stop_force / 4 if stop_force is None else stop_force
        self._runs = 0
        self.identity: dict[str, object] = {}

    def refuse(self, visits: Sequence[Visit]) -> None:
        """Raise ConfigurationError where a motion of a step breaks a limit; nothing moves for it."""
        for name, own in own_motions(self._pipeline.devices).items():
            if problems := check_own_motion(own, self._limits):
                raise ConfigurationError(f"{self._pipeline.path}: [device.{name}]: {'; '.join(problems)}")
        for visit in visits:
            strokes_pipeline(self._pipeline, self._strokes(visit), self._force_of(visit))

    def outcomes(self, visits: Sequence[Visit]) -> Iterator[Outcome]:
        """One step after the other."""
        site = ""
        for number, visit in enumerate(visits, 1):
            if visit.site != site:
                site = visit.site
                self._guide.ask(self._preparation(visit))
            self._guide.say(f"step {number} of {len(visits)}, {visit.name}: {visit.step.what}")
            yield self._outcome(visit)

    def _preparation(self, visit: Visit) -> str:
        begin = "take everything from under the tip" if visit.site == "free-air" else "lay foam under the tip"
        strokes = self._strokes(visit)
        return (
            f"{begin}; bring the tip, in free air, near the middle of the box; the arm will move between heights of "
            f"{1e3 * strokes.bottom:.1f} and {1e3 * strokes.top:.1f} mm; keep clear, a hand at the emergency stop"
        )

    def _strokes(self, visit: Visit) -> Strokes:
        return plan_strokes(self._pipeline, visit, self._allowed(visit.step).reaction)

    def _force_of(self, visit: Visit) -> float | None:
        return self._stop_force if visit.step.name == "force" else None

    def _allowed(self, step: AcceptanceStep) -> Allowed:
        limits: SafetySettings = self._limits
        blind = own_motions(self._pipeline.devices)[self._arm.name].blind
        of = {
            "latency": limits.latency,
            "reaction": limits.prompt_reaction,
            "sensor_timeout": limits.sensor_timeout,
            "sensor_delay": limits.sensor_delay or 0.0,
            "blind": max(blind, limits.latency),
        }
        return Allowed(of[step.bound], limits.deceleration)

    def _outcome(self, visit: Visit) -> Outcome:
        step, allowed, why = visit.step, self._allowed(visit.step), ""
        for _ in range(_ATTEMPTS):
            if why:
                self._guide.say(f"  once more: {why}")
            try:
                outcome = self._attempt(visit, allowed)
            except MissedError as error:
                why = str(error)
                self._recover(visit)
                continue
            except DeviceError as error:
                why = str(error)
                self._guide.ask(f"  nothing moved: {why}; see to that")
                continue
            self._recover(visit)
            return outcome
        return Outcome(visit, allowed, None, f"{step.name} in {_ATTEMPTS} attempts: {why}")

    def _recover(self, visit: Visit) -> None:
        lift = "lift the tip out of the foam" if visit.site == "foam" and not visit.step.leaves else ""
        if what := "; ".join(text for text in (visit.step.then, lift) if text):
            self._guide.ask(f"  {what}")

    def _attempt(self, visit: Visit, allowed: Allowed) -> Outcome:
        self._runs += 1
        folder = self._folder / f"{self._runs:02d}-{visit.name.replace('/', '-')}"
        strokes, origin = self._strokes(visit), host_time_ns()
        run = StrokesRun(folder, strokes, self._force_of(visit))
        with (
            observed_run(self._arm, self._pipeline.run.seed, run) as observer,
            self._start(run) as job,
        ):
            try:
                event = self._stopped(visit, observer, job, strokes, origin)
            finally:
                self.identity = self.identity or observer.health
            trace = observer.trace(origin)
            if not visit.step.stops:
                if stop := job.run.live_facts.get("stop"):
                    raise MissedError(stop["reason"])
                found = measure_force_delay(trace, *self._tared(job, origin))
                return Outcome(visit, allowed, None, self._told(job) or "it came to its end", found, self._answers(job))
            event = self._event_of(visit, observer, job, origin) if event is None else event
            after, planned = self._state_after(visit, job), strokes.speed * self._pace(visit)
            report = "; ".join(filter(None, (self._told(job), self._place(after))))
            if after is not None and visit.step.number == signal.SIGKILL:
                standstill = measure_standstill(trace, event, planned, after.height, after.movement)
                return Outcome(visit, allowed, None, report, standstill=standstill)
            braking = measure_braking(trace, event, planned, visit.step.leaves)
            return Outcome(visit, allowed, braking, report, answers=self._answers(job))

    def _pace(self, visit: Visit) -> float:
        """Return the share of a commanded speed at which the tip of an arm on a spring goes into the material.

        A tip on a spring k [N/m] goes k/(k + K) of its command's way into a material of K [N/m].
        """
        spring = getattr(self._arm.device, "controller_stiffness", None)
        if visit.site == "free-air" or spring is None:
            return 1.0
        return float(spring / (spring + self._limits.stiffness))

    def _state_after(self, visit: Visit, job: StrokesJob) -> StateAfterRun | None:
        """Return the arm's state by a connection after a run that could not record all of its states, else None."""
        if not (self._arm.modes.single_connection and visit.step.interrupts_record):
            return None
        self._wait(lambda: not job.has_processes, _LONGEST)  # one of them has the connection
        return state_after_run(self._arm, self._pipeline.run.seed)

    def _place(self, after: StateAfterRun | None) -> str:
        if after is None:
            return ""
        state = f"{self._arm.modes.channel} {after.mode}"
        return f"connected to again, the tip is at {1e3 * after.height:.1f} mm, {state}"

    def _answers(self, job: StrokesJob) -> tuple[Mapping[str, float], ...]:
        """What the arm has answered to its first commands; nothing of a run that was killed."""
        devices: Mapping[str, Mapping[str, Any]] = job.run.live_facts.get("devices") or {}
        return tuple(devices.get(self._arm.name, {}).get("handshake", ()))

    def _told(self, job: StrokesJob) -> str:
        stop = job.run.live_facts.get("stop") or {}
        return str(stop.get("reason", "")) or job.run.message.partition("\n")[0]

    def _stopped(
        self, visit: Visit, observer: Observer, job: StrokesJob, strokes: Strokes, origin: int
    ) -> float | None:
        """Wait until the arm has been stopped and stands; when [s] this program did it, None where it did not."""
        step, event = visit.step, None
        if step.number is not None:
            self._wait_for_the_way_down(visit, observer, job, strokes)
            event = (host_time_ns() - origin) / 1e9
            job.send(step.number, step.group)
        elif step.by_hand:
            self._wait_for_a_hand(visit, observer, job, strokes)
        else:
            self._wait(lambda: not job.is_running, _START + 2.0 * strokes.lasts)
        if step.number == signal.SIGSTOP:
            clock().sleep(self._allowed(step).reaction)  # until then a run that records the states shows none
        self._wait_for_rest(observer)
        if step.number == signal.SIGSTOP:
            job.send(signal.SIGCONT)
        self._wait(lambda: not job.is_running, _LONGEST)
        return event

    def _wait_for_the_way_down(self, visit: Visit, observer: Observer, job: StrokesJob, strokes: Strokes) -> None:
        """Until the tip goes down at full speed with room for what is allowed; on foam as deep as leaves that."""
        high, low = strokes.straight
        last = low + strokes.speed * self._allowed(visit.step).reaction
        first = min(last + strokes.speed * _MARGIN, high) if visit.site == "foam" else high

        latest, steady = 0.0, _STEADY * self._pace(visit) * strokes.speed  # [s] that states were late; [m/s]

        def there() -> bool:
            nonlocal latest
            latest = max(latest, observer.lag)
            return observer.velocity < -steady and last < observer.height_now <= first

        self._wait(lambda: there() or not job.is_running, _START + strokes.duration, observer)
        if not job.is_running and latest > _LATE:
            raise MissedError(f"this computer is too busy to watch the arm: its states came {latest:.1f} s late")
        if not job.is_running:
            raise self._refusal(job)

    def _wait_for_a_hand(self, visit: Visit, observer: Observer, job: StrokesJob, strokes: Strokes) -> None:
        """Until the run has ended, with a word at each beginning of a way down."""
        on_the_way_down, (high, _) = visit.step.leaves, strokes.straight
        when = "as soon as this says NOW, for the tip goes down then" if on_the_way_down else "while the tip moves"
        self._guide.say(f"  {visit.step.ask}, {when}")
        was_down, deadline = False, clock().now() + _START + strokes.duration
        while job.is_running and clock().now() < deadline:
            # Not on the way to the strokes, which may lead down from above their top.
            is_upper_half = 0.5 * (high + strokes.bottom) < observer.height <= high
            down = is_upper_half and observer.velocity < -_STEADY * self._pace(visit) * strokes.speed
            if down and not was_down:
                if on_the_way_down:
                    self._guide.say("  NOW")
                self._guide.act(visit.step)
            was_down = down
            clock().sleep(_LOOK)
        if np.isnan(observer.height) or not job.run.live_facts.get("stop"):
            raise self._refusal(job)

    def _refusal(self, job: StrokesJob) -> Exception:
        """Why a run ended before it was stopped: nothing to wait for where it never moved."""
        if job.run.live_facts.get("stop") is None and job.run.message:
            return DeviceError(f"the run of the strokes did not begin: {job.run.message} ({job.run.folder})")
        return MissedError(job.run.message or "the strokes came to their end, and nothing had stopped them")

    def _event_of(self, visit: Visit, observer: Observer, job: StrokesJob, origin: int) -> float:
        """When [s] it happened, by what the robot or the sensor said."""
        if visit.step.mode:
            return observer.mode_change(origin, visit.step.mode)
        if visit.step.name != "force":
            return float(self._readings(job, origin)[0][-1])
        try:
            return first_beyond(*self._tared(job, origin), self._stop_force)
        except MissedError as error:
            raise MissedError(f"{error}: {self._told(job)}") from error

    @staticmethod
    def _readings(job: StrokesJob, origin: int) -> tuple[Floats, Floats]:
        time, force = job.run.readings(origin)
        if not len(time):
            raise MissedError("the sensor sent no readings")
        return time, force

    def _tared(self, job: StrokesJob, origin: int) -> tuple[Floats, Floats]:
        time, force = self._readings(job, origin)
        standstill = job.run.live_facts.get("standstill")
        if standstill is None:
            raise self._refusal(job)
        return time, force - standstill["force"]

    def _wait_for_rest(self, observer: Observer) -> None:
        """Until the arm has stood for a while, or for as long as patience lasts."""
        height, since, deadline = observer.height, clock().now(), clock().now() + _LONGEST
        while clock().now() - since < _REST and clock().now() < deadline:
            if abs(observer.height - height) > STANDSTILL_MOVEMENT:
                height, since = observer.height, clock().now()
            clock().sleep(_LOOK)

    @staticmethod
    def _wait(condition: Callable[[], bool], patience: float, observer: Observer | None = None) -> None:
        deadline = clock().now() + patience
        while not condition():
            if observer is not None and observer.failure is not None:
                raise MissedError(observer.failure)
            if clock().now() > deadline:
                raise MissedError(f"nothing happened within {patience:.0f} s")
            clock().sleep(_LOOK)
