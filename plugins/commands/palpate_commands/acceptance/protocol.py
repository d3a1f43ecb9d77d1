"""An acceptance protocol at work: one stop after the other, each watched from outside the run that is stopped."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from palpate import ConfigurationError, DeviceError, clock, host_time_ns
from palpate_engine import Pipeline, SafetySettings, check_own_motion, own_motions

from palpate_commands.acceptance.job import StrokesJob
from palpate_commands.acceptance.measurement import MissedError
from palpate_commands.acceptance.observer import Observer, observed_run
from palpate_commands.acceptance.outcome import STANDSTILL_MOVEMENT, Allowed, Outcome
from palpate_commands.acceptance.steps import AcceptanceStep, Visit
from palpate_commands.acceptance.strokes import Strokes, demand_limits, plan_strokes, strokes_pipeline
from palpate_commands.acceptance.strokes_run import StrokesRun
from palpate_commands.acceptance.watched_arm import WatchedArm
from palpate_commands.acceptance.watched_run import POLL_INTERVAL, REST_TIMEOUT, WatchedRun, wait_until

# Choices.
_MAX_ATTEMPTS = 4  # at one step
_START_TIMEOUT = 60.0  # [s] for a run to begin its strokes: processes, connections, way to the start
_STROKES_TIMEOUT = 2.0  # times their duration but for the turns, for strokes to end by themselves
_REST_TIME = 0.5  # [s] without motion, after which the arm stands
_WAY_MARGIN = 0.25  # [s] of straight way on foam beyond the time that is allowed, if there is so much
_MAX_LATENESS = 0.2  # [s] of states, above which no stroke can be hit
_MIN_SPEED_SHARE = 0.75  # of the speed of the strokes: on a busy computer they are slower
_STOP_FORCE_SHARE = 0.25  # of the pipeline's stop_force, for the step `force`


@dataclass(frozen=True)
class AcceptanceGuide:
    """Words to a person, and acts in place of one."""

    say: Callable[[str], None]
    ask: Callable[[str], None]  # returns once the person has done it
    act: Callable[[AcceptanceStep], None] = lambda step: None  # of a twin in place of a person, on the way down


class AcceptanceProtocol:
    """The protocol on one rig: each step moves the arm, has it stopped, and measures the stop."""

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
        self._stop_force = _STOP_FORCE_SHARE * self._limits.stop_force if stop_force is None else stop_force
        self._runs = 0
        self.identity: dict[str, object] = {}

    def refuse(self, visits: Sequence[Visit]) -> None:
        """Raise ConfigurationError where a motion of a step breaks a limit; nothing moves for it."""
        for name, motion in own_motions(self._pipeline.devices).items():
            if problems := check_own_motion(motion, self._limits):
                raise ConfigurationError(f"{self._pipeline.path}: [device.{name}]: {'; '.join(problems)}")
        for visit in visits:
            strokes_pipeline(self._pipeline, self._strokes(visit), self._force_of(visit))

    def outcomes(self, visits: Sequence[Visit]) -> Iterator[Outcome]:
        """Yield the outcome of each step, one after the other; at each new site the person prepares it."""
        site = ""
        for number, visit in enumerate(visits, 1):
            if visit.site != site:
                site = visit.site
                self._guide.ask(self._preparation(visit))
            self._guide.say(f"step {number} of {len(visits)}, {visit.name}: {visit.step.event}")
            yield self._outcome(visit)

    def _preparation(self, visit: Visit) -> str:
        """Return what a person does before the first step of a site."""
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
        """Return the bounds that the rig declares for a step."""
        limits: SafetySettings = self._limits
        blind_time = own_motions(self._pipeline.devices)[self._arm.name].blind
        reactions = {
            "latency": limits.latency,
            "reaction": limits.prompt_reaction,
            "sensor_timeout": limits.sensor_timeout,
            "sensor_delay": limits.sensor_delay or 0.0,
            "blind": max(blind_time, limits.latency),
        }
        return Allowed(reactions[step.bound], limits.deceleration)

    def _outcome(self, visit: Visit) -> Outcome:
        """Return the outcome of a visit, a step at a site, by the first attempt that shows a stop.

        After the last attempt it is an outcome without a measurement, with the reason.
        """
        step, allowed, reason = visit.step, self._allowed(visit.step), ""
        for _ in range(_MAX_ATTEMPTS):
            if reason:
                self._guide.say(f"  once more: {reason}")
            try:
                outcome = self._attempt(visit, allowed)
            except MissedError as error:
                reason = str(error)
                self._recover(visit)
                continue
            except DeviceError as error:
                reason = str(error)
                self._guide.ask(f"  nothing moved: {reason}; see to that")
                continue
            self._recover(visit)
            return outcome
        return Outcome(visit, allowed, None, f"{step.name} in {_MAX_ATTEMPTS} attempts: {reason}")

    def _recover(self, visit: Visit) -> None:
        """Ask for what makes the arm ready again after a step."""
        tasks = [visit.step.then] if visit.step.then else []
        if visit.site == "foam" and not visit.step.leaves:
            tasks.append("lift the tip out of the foam")
        if tasks:
            self._guide.ask(f"  {'; '.join(tasks)}")

    def _attempt(self, visit: Visit, allowed: Allowed) -> Outcome:
        """Return the outcome of one run that is stopped; raises MissedError where it shows no stop.

        Raises DeviceError where the run did not begin.
        """
        self._runs += 1
        folder = self._folder / f"{self._runs:02d}-{visit.name.replace('/', '-')}"
        run, origin = StrokesRun(folder, self._strokes(visit), self._force_of(visit)), host_time_ns()
        with (
            observed_run(self._arm, self._pipeline.run.seed, run) as observer,
            self._start(run) as job,
        ):
            watched = WatchedRun(visit, allowed, self._arm, self._limits.stiffness, observer, job, origin)
            try:
                event = self._stop(watched)
            finally:
                self.identity = self.identity or observer.health
            return watched.outcome(event, self._pipeline.run.seed)

    def _stop(self, run: WatchedRun) -> float | None:
        """Stop the arm, or wait until it is stopped, and then until it stands.

        Return the time [s] of a signal that this program sent; None without one.
        """
        step, job, event = run.visit.step, run.job, None
        # The signal `number`, a person's act, or the end of the run by itself.
        if step.number is not None:
            _wait_for_way_down(run)
            event = (host_time_ns() - run.origin) / 1e9
            job.send(step.number, step.group)
        elif step.by_hand:
            self._wait_for_hand(run)
        else:
            wait_until(lambda: not job.is_running, _START_TIMEOUT + _STROKES_TIMEOUT * job.run.strokes.lasts)
        # A process that stands still goes on once the arm has come to rest without it.
        if step.number == signal.SIGSTOP:
            clock().sleep(run.allowed.reaction)  # until then a run that records the states shows none
        _wait_for_rest(run.observer)
        if step.number == signal.SIGSTOP:
            job.send(signal.SIGCONT)
        wait_until(lambda: not job.is_running, REST_TIMEOUT)
        return event

    def _wait_for_hand(self, run: WatchedRun) -> None:
        """Wait until the run has ended, with a word at each beginning of a way down.

        Raises MissedError where nothing has stopped it, and DeviceError where it did not begin.
        """
        step, job, observer, strokes = run.visit.step, run.job, run.observer, run.job.run.strokes
        # A step at which the arm leaves the material shows its braking only on the way down.
        needs_way_down, (high, _) = step.leaves, strokes.straight
        time_words = "as soon as this says NOW, for the tip goes down then" if needs_way_down else "while the tip moves"
        self._guide.say(f"  {step.ask}, {time_words}")
        middle = 0.5 * (high + strokes.bottom)
        min_speed = _MIN_SPEED_SHARE * run.tip_speed
        was_down, deadline = False, clock().now() + _START_TIMEOUT + strokes.duration
        while job.is_running and clock().now() < deadline:
            # Not on the way to the strokes, which may lead down from above their top.
            is_down = middle < observer.height <= high and observer.velocity < -min_speed
            if is_down and not was_down:
                if needs_way_down:
                    self._guide.say("  NOW")
                self._guide.act(step)
            was_down = is_down
            clock().sleep(POLL_INTERVAL)
        if np.isnan(observer.height) or not job.run.live_facts.get("stop"):
            raise run.refusal()


def _wait_for_way_down(run: WatchedRun) -> None:
    """Wait until the tip goes down at full speed with room for the allowed way; on foam as deep as leaves that.

    Raises MissedError where the run ends before, and DeviceError where it did not begin.
    """
    job, observer, strokes = run.job, run.observer, run.job.run.strokes
    # Heights between which the event leaves the allowed way at constant speed.
    high, low = strokes.straight
    last = low + strokes.speed * run.allowed.reaction
    first = min(last + strokes.speed * _WAY_MARGIN, high) if run.visit.site == "foam" else high
    min_speed = _MIN_SPEED_SHARE * run.tip_speed
    max_lag = 0.0  # [s] of the states

    def is_on_way_down() -> bool:
        nonlocal max_lag
        max_lag = max(max_lag, observer.lag)
        return observer.velocity < -min_speed and last < observer.height_now <= first

    wait_until(lambda: is_on_way_down() or not job.is_running, _START_TIMEOUT + strokes.duration, observer)
    if not job.is_running and max_lag > _MAX_LATENESS:
        raise MissedError(f"this computer is too busy to watch the arm: its states came {max_lag:.1f} s late")
    if not job.is_running:
        raise run.refusal()


def _wait_for_rest(observer: Observer) -> None:
    """Wait until the arm has stood for a while, at most until the timeout."""
    height, still_since, deadline = observer.height, clock().now(), clock().now() + REST_TIMEOUT
    while clock().now() - still_since < _REST_TIME and clock().now() < deadline:
        if abs(observer.height - height) > STANDSTILL_MOVEMENT:
            height, still_since = observer.height, clock().now()
        clock().sleep(POLL_INTERVAL)
