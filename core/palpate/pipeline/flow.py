"""How batches flow: as fast as they are read, or as time goes by."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from palpate.clocks import clock
from palpate.device import Arm, Batch, Link, Watched, ask_devices, is_live
from palpate.errors import ConfigurationError, DeviceError
from palpate.pipeline.guard import Guard
from palpate.pipeline.interrupt import Interrupt
from palpate.pipeline.live import LiveLinks
from palpate.pipeline.readying import feel, hand_limits, ready, refuse_leading, refuse_preload, stored_offset
from palpate.pipeline.rig import Rig
from palpate.pipeline.scheduling import undisturbed
from palpate.pipeline.start import refuse_own_motion
from palpate.result import finite_tree
from palpate.safety import SafetySettings, demand_safe
from palpate.trajectory import Trajectory

# Log time [s], total [s] where known, how far the estimates are behind [s].
Progress = Callable[[float, float | None, float], None]
Arrivals = Sequence[tuple[str, Batch]]  # batches that arrived together, each with its device


@dataclass(frozen=True)
class Taken:
    """How far a record has become samples and estimates."""

    sampled: float  # [s]
    behind: float = 0.0  # [s] that the estimates are behind the samples


Take = Callable[[Arrivals], Taken | None]  # None: no samples are made of them
Noise = Mapping[str, tuple[float, float]]  # what estimators count on, by name: force [N], velocity [m/s]

_LOOK = 5e-3  # [s] between the setpoints that devices are asked about before anything moves
_PATIENCE = 8.0  # [s] for a retraction


class Flow:
    """Gives every batch to the one who takes it; keeps what a live run is to say of itself."""

    def __init__(self, rig: Rig, take: Take, interrupt: Interrupt, noise: Noise | None = None) -> None:
        self._pipeline, self._take, self._interrupt, self._noise = rig, take, interrupt, noise or {}
        self.total: float | None = None  # [s] how long it takes, where that is known
        self._sampled: float | None = None  # [s] of the record that have become samples
        self.facts: dict[str, Any] = {}  # of a live run
        self.guard: Guard | None = None  # of a live run
        self.links: Mapping[str, Link] = {}
        self._live_links: LiveLinks | None = None

    def run(self) -> None:
        """Connect, set in motion, and pass every batch on until there are no more."""
        if is_live(self._pipeline.devices):
            self._run_live()
        else:
            self._run_read()

    def _pass_on(self, arrivals: Arrivals) -> None:
        taken = self._take(arrivals)
        if taken is not None:
            self._sampled = taken.sampled
            if self._live_links is not None:
                self._live_links.behind = taken.behind > 0

    def _run_read(self) -> None:
        pipeline = self._pipeline
        with ExitStack() as stack:
            links = {name: stack.enter_context(d.connect(pipeline.run.seed)) for name, d in pipeline.devices.items()}
            arms = [link for link in links.values() if isinstance(link, Arm)]
            if arms:
                trajectory = the_trajectory(pipeline)
                self.total = trajectory.total_duration
                if pipeline.safety is not None:
                    demand_safe(trajectory, pipeline.safety, str(pipeline.path))
                _demand_willing(pipeline, trajectory)
                for arm in arms:
                    stack.callback(arm.stop)
                    refuse_leading(arm, trajectory)
                    arm.follow(trajectory)
            else:
                durations = [d.duration for d in pipeline.devices.values() if d.duration is not None]
                self.total = max(durations, default=None)
            for arrival in merged(links):
                self._pass_on([arrival])
                if self._interrupt.reason is not None:
                    return

    def _run_live(self) -> None:
        pipeline, limits = self._pipeline, self._pipeline.safety
        trajectory = the_trajectory(pipeline) if pipeline.trajectories else None
        if trajectory is not None and limits is None:
            raise ConfigurationError(
                f"{pipeline.path}: a live robot needs a [safety] table: workspace, speed and force limits"
            )
        if trajectory is not None and limits is not None:
            demand_safe(trajectory, limits, str(pipeline.path))
            refuse_own_motion(pipeline, limits)
            _demand_willing(pipeline, trajectory)
        began, before = clock().now(), clock().processor_time()
        guard = Guard(limits, pipeline.ports)
        with ExitStack() as stack:
            self.facts["scheduling"] = stack.enter_context(undisturbed())
            links = self.links = connected(pipeline, stack)
            arms = {name: link for name, link in links.items() if isinstance(link, Arm)}
            live = self._live_links = LiveLinks(links, guard)
            stack.callback(self._account, guard, live, links)
            for arm in arms.values():
                stack.callback(arm.stop)
            stack.callback(live.stop)
            stack.callback(guard.close)
            self.guard = guard
            self._interrupt.trips(guard.trip)
            live.start()
            self._live(live, guard, arms, trajectory)
            guard.close()
            live.stop()
            for arrivals in live.remaining():
                self._pass_on(arrivals)
            self._live_links = None
        # Children that have ended count as well; what the devices did is all in here.
        used = clock().processor_time() - before
        self.facts["cpu_cores"] = used / max(clock().now() - began, 1e-9)
        if guard.reason is not None and self._interrupt.reason is None:
            raise DeviceError(guard.reason)

    def _live(self, live: LiveLinks, guard: Guard, arms: Mapping[str, Arm], trajectory: Trajectory | None) -> None:
        """Stand still, judge the standstill, move, until the arms are done or the guard has tripped."""
        limits = self._pipeline.safety
        standstill = limits.standstill if limits else 1.0
        self._stand_still(live, guard, standstill)
        if guard.reason is not None or self._interrupt.reason is not None:
            return
        self.facts["standstill"] = guard.judge_standstill(self._noise).table()
        if not self._has_sampled(standstill):
            raise DeviceError(
                f"within {standstill + _PATIENCE:g} s the streams gave no samples of {standstill:g} s in common"
            )
        if arms and trajectory is None:
            raise ConfigurationError(f"{self._pipeline.path}: a robot needs one [trajectory.*] table")
        if trajectory is not None and limits is not None and arms:
            self._make_ready(live, guard, arms, trajectory, limits)
        else:
            guard.begin(arms)
        if guard.reason is not None or self._interrupt.reason is not None:
            return
        for arm in arms.values():
            assert trajectory is not None
            self.total = trajectory.total_duration + standstill
            arm.follow(trajectory)
        try:
            for arrivals in live.to_the_end(_PATIENCE):
                self._pass_on(arrivals)
                if self._interrupt.reason is not None:
                    guard.trip(self._interrupt.reason)  # a signal takes note, and trips nothing
        except BaseException as error:
            guard.trip(f"{type(error).__name__}: {error}")
            for _ in live.to_the_end(_PATIENCE):
                pass  # let the arms retract
            raise

    def _make_ready(
        self, live: LiveLinks, guard: Guard, arms: Mapping[str, Arm], trajectory: Trajectory, limits: SafetySettings
    ) -> None:
        """Limits for the arms, the way to the start, and a retreat that feels whether the tip is free."""

        def stopped() -> bool:
            return guard.reason is not None or self._interrupt.reason is not None

        health = {name: link.health for name, link in live.links.items() if isinstance(link, Watched)}
        offset = stored_offset(self._pipeline, health)
        known = None
        if offset is not None:
            self.facts["offset"] = offset.table()
            known = offset.value if offset.doubt is None else None
        refuse_preload(self.facts["standstill"]["force"], limits, guard.force, known)
        hand_limits(live.links, guard, limits)
        ready(list(arms.values()), trajectory, limits)
        guard.begin(arms)
        felt = feel(list(arms.values()), live, guard, self._pass_on, stopped)
        if felt is not None:
            self.facts["felt"] = felt.table()
            ready(list(arms.values()), trajectory, limits)

    def _stand_still(self, live: LiveLinks, guard: Guard, standstill: float) -> None:
        """Pass on what comes until the samples, and not only the host's clock, say that the standstill is over.

        So the standstill is the same stretch of the record in a replay, where there is no host's clock.
        """
        began = clock().now()
        # A device may be slow to begin; one that has failed trips the guard.
        while (
            not (guard.has_stood_still and self._has_sampled(standstill))
            and clock().now() - began < standstill + _PATIENCE
        ):
            for arrivals in live.until(max(began + standstill, clock().now() + 0.02)):
                self._pass_on(arrivals)
            if guard.reason is not None or self._interrupt.reason is not None:
                return

    def _has_sampled(self, span: float) -> bool:
        return self._sampled is None or self._sampled >= span

    def _account(self, guard: Guard, live: LiveLinks, links: Mapping[str, Link]) -> None:
        self.facts["devices"] = {
            name: finite_tree(link.health) for name, link in links.items() if isinstance(link, Watched)
        }
        self.facts["largest_backlog"] = live.largest_backlog
        self.facts["peak_force"] = guard.peak
        self.facts["peak_force_untared"] = guard.peak_untared
        if guard.ended_early:
            self.facts["ended_early"] = sorted(guard.ended_early)
        if guard.reason is not None and guard.tripped is not None:
            self.facts["stop"] = {"reason": guard.reason, "monotonic": guard.tripped}


def each(take: Callable[[str, Batch], None]) -> Take:
    """Takes arrivals one by one, for those who make no samples of them."""

    def taken(arrivals: Arrivals) -> None:
        for device, batch in arrivals:
            take(device, batch)

    return taken


def _demand_willing(pipeline: Rig, trajectory: Trajectory) -> None:
    """Raise ConfigurationError where a device refuses the motion; nothing moves for it."""
    ask_devices(pipeline.devices, trajectory.at(np.arange(0.0, trajectory.total_duration, _LOOK)))


def connected(pipeline: Rig, stack: ExitStack) -> dict[str, Link]:
    """Links of all devices, connected side by side; those that came about are left with the stack if one fails."""
    contexts = {name: device.connect(pipeline.run.seed) for name, device in pipeline.devices.items()}
    links: dict[str, Link] = {}
    failures: dict[str, BaseException] = {}

    def enter(name: str) -> None:
        try:
            links[name] = contexts[name].__enter__()
        except BaseException as error:  # it is raised where the run can handle it
            failures[name] = error

    threads = [clock().thread(partial(enter, name), f"connect {name}") for name in contexts]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for name in contexts:
        if name in links:
            stack.push(contexts[name])
    for name in contexts:
        if name in failures:
            raise failures[name]
    return {name: links[name] for name in contexts}


def the_trajectory(pipeline: Rig) -> Trajectory:
    """The one motion of a pipeline; raises ConfigurationError where there is none, or more."""
    if len(pipeline.trajectories) != 1:
        count = len(pipeline.trajectories)
        raise ConfigurationError(f"{pipeline.path}: a device that moves needs one [trajectory.*] table, not {count}")
    return next(iter(pipeline.trajectories.values()))


def merged(links: Mapping[str, Link]) -> Iterator[tuple[str, Batch]]:
    """Batches of all links, always from the one that is furthest behind in time."""
    streams = {name: link.batches() for name, link in links.items()}
    heads: dict[str, Batch] = {}
    while True:
        for name in [name for name in streams if name not in heads]:
            batch = next((batch for batch in streams[name] if len(batch.time)), None)
            if batch is None:
                del streams[name]
            else:
                heads[name] = batch
        if not heads:
            return
        name = min(heads, key=lambda name: int(heads[name].received[0]))
        yield name, heads.pop(name)
