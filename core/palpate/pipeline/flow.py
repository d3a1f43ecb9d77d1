"""How batches flow: as fast as they are read, or as time goes by."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from typing import Any

import numpy as np

from palpate.device import Arm, Batch, Link, Watched
from palpate.errors import ConfigurationError, DeviceError
from palpate.pipeline.guard import Guard
from palpate.pipeline.interrupt import Interrupt
from palpate.pipeline.live import LiveLinks
from palpate.pipeline.rig import Rig
from palpate.pipeline.scheduling import undisturbed
from palpate.pipeline.start import check_way, refuse_own_motion
from palpate.result import finite
from palpate.safety import demand_safe
from palpate.trajectory import Trajectory

Progress = Callable[[float, float | None], None]  # log time [s], total [s] where known
Take = Callable[[str, Batch], float | None]  # device, batch -> how far [s] the record has become samples, if it does
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

    def run(self) -> None:
        """Connect, set in motion, and pass every batch on until there are no more."""
        if any(device.live for device in self._pipeline.devices.values()):
            self._run_live()
        else:
            self._run_read()

    def _pass_on(self, device: str, batch: Batch) -> None:
        self._sampled = self._take(device, batch)

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
                _ask_the_devices(pipeline, trajectory)
                for arm in arms:
                    stack.callback(arm.stop)
                    arm.follow(trajectory)
            else:
                durations = [d.duration for d in pipeline.devices.values() if d.duration is not None]
                self.total = max(durations, default=None)
            for device, batch in merged(links):
                self._pass_on(device, batch)
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
            _ask_the_devices(pipeline, trajectory)
        began, before = time.monotonic(), os.times()
        guard = Guard(limits, pipeline.alignment, {name: d.streams for name, d in pipeline.devices.items()})
        with ExitStack() as stack:
            self.facts["scheduling"] = stack.enter_context(undisturbed())
            links = connected(pipeline, stack)
            arms = [link for link in links.values() if isinstance(link, Arm)]
            live = LiveLinks(links, guard)
            stack.callback(self._account, guard, live, links)
            for arm in arms:
                stack.callback(arm.stop)
            stack.callback(live.stop)
            stack.callback(guard.close)
            live.start()
            self._live(live, guard, arms, trajectory)
            guard.close()
            live.stop()
            for device, batch in live.rest():
                self._pass_on(device, batch)
        # Children that have ended count as well; what the devices did is all in here.
        used = sum(os.times()[:4]) - sum(before[:4])
        self.facts["cpu_cores"] = used / (time.monotonic() - began)
        if guard.reason is not None and self._interrupt.reason is None:
            raise DeviceError(guard.reason)

    def _live(self, live: LiveLinks, guard: Guard, arms: list[Arm], trajectory: Trajectory | None) -> None:
        """Rest, judge the rest, move, until the arms are done or somebody has tripped the guard."""
        limits = self._pipeline.safety
        rest = limits.rest if limits else 1.0
        self._rest(live, guard, rest)
        if guard.reason is not None or self._interrupt.reason is not None:
            return
        self.facts["rest"] = guard.judge_rest(self._noise).table()
        if not self._has_sampled(rest):
            raise DeviceError(f"within {rest + _PATIENCE:g} s the streams gave no samples of {rest:g} s in common")
        for arm in arms:
            if trajectory is None:
                raise ConfigurationError(f"{self._pipeline.path}: a robot needs one [trajectory.*] table")
            if limits is not None:
                check_way(arm, trajectory, limits)
        guard.begin(arms)
        for arm in arms:
            assert trajectory is not None
            self.total = trajectory.total_duration + rest
            arm.follow(trajectory)
        try:
            for item in live.to_the_end(_PATIENCE):
                if item is not None:
                    self._pass_on(*item)
                if self._interrupt.reason is not None:
                    guard.trip(self._interrupt.reason)
        except BaseException as error:
            guard.trip(f"{type(error).__name__}: {error}")
            for _ in live.to_the_end(_PATIENCE):
                pass  # let the arms retract
            raise

    def _rest(self, live: LiveLinks, guard: Guard, rest: float) -> None:
        """Pass on what comes until the samples, and not only the host's clock, say that the rest is over.

        So the rest is the same stretch of the record in a replay, where there is no host's clock.
        """
        began = time.monotonic()
        # A device may be slow to begin; one that has failed trips the guard.
        while not (guard.rested and self._has_sampled(rest)) and time.monotonic() - began < rest + _PATIENCE:
            for device, batch in live.until(max(began + rest, time.monotonic() + 0.02)):
                self._pass_on(device, batch)
            if guard.reason is not None or self._interrupt.reason is not None:
                return

    def _has_sampled(self, span: float) -> bool:
        return self._sampled is None or self._sampled >= span

    def _account(self, guard: Guard, live: LiveLinks, links: Mapping[str, Link]) -> None:
        self.facts["devices"] = {
            name: _finite_table(link.health) for name, link in links.items() if isinstance(link, Watched)
        }
        self.facts["largest_backlog"] = live.largest_backlog
        self.facts["peak_force"] = guard.peak
        if guard.reason is not None and guard.tripped is not None:
            self.facts["stop"] = {"reason": guard.reason, "monotonic": guard.tripped}


def _ask_the_devices(pipeline: Rig, trajectory: Trajectory) -> None:
    """Let every device refuse the motion before anything moves; they raise ConfigurationError."""
    setpoint = trajectory.at(np.arange(0.0, trajectory.total_duration, _LOOK))
    for device in pipeline.devices.values():
        device.refuse(setpoint)


def _finite_table(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _finite_table(item) for key, item in value.items()}
    return finite(value)


def connected(pipeline: Rig, stack: ExitStack) -> dict[str, Link]:
    """Links of all devices, connected side by side; those that came about are left with the stack if one fails."""
    contexts = {name: device.connect(pipeline.run.seed) for name, device in pipeline.devices.items()}
    links, failures = {}, []
    with ThreadPoolExecutor(len(contexts)) as pool:
        entering = {name: pool.submit(context.__enter__) for name, context in contexts.items()}
    for name, future in entering.items():
        if (error := future.exception()) is None:
            stack.push(contexts[name])
            links[name] = future.result()
        else:
            failures.append(error)
    if failures:
        raise failures[0]
    return links


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
