"""How batches flow: as fast as they are read, or in real time."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack

from palpate.clocks import clock
from palpate.device import Arm, Link, is_live
from palpate.errors import DeviceError
from palpate.trajectory import duration_of

from palpate_engine.pipeline.arrivals import Take, merge_batches
from palpate_engine.pipeline.interrupt import Interrupt
from palpate_engine.pipeline.live.approach import check_force_control
from palpate_engine.pipeline.live.guard import Guard
from palpate_engine.pipeline.live.links import connect_devices
from palpate_engine.pipeline.live.live_facts import LiveFacts, motion_facts
from palpate_engine.pipeline.live.live_run import LiveRun
from palpate_engine.pipeline.live.scheduling import real_time_section
from palpate_engine.pipeline.live.standstill import Noise
from palpate_engine.pipeline.live.states import compensable_offset, get_ready, move, stand_still
from palpate_engine.pipeline.planned_motion import check_live_motion, check_recorded_motion, single_trajectory
from palpate_engine.pipeline.rig import Rig


class Flow:
    """Passes each batch to `take`, and collects the facts of a live run."""

    def __init__(self, rig: Rig, take: Take, interrupt: Interrupt, noise: Noise | None = None) -> None:
        self._rig, self._take, self._interrupt, self._noise = rig, take, interrupt, noise or {}
        self.total: float | None = None  # [s] how long it takes, where that is known
        self.facts: LiveFacts | None = None  # of a live run
        self.guard: Guard | None = None  # of a live run
        self.links: Mapping[str, Link] = {}  # of a live run

    def run(self) -> None:
        """Connect, set in motion, and pass every batch on until there are no more."""
        if is_live(self._rig.devices):
            self._run_live()
        else:
            self._run_read()

    def _run_read(self) -> None:
        rig = self._rig
        with ExitStack() as stack:
            links = {name: stack.enter_context(d.connect(rig.run.seed)) for name, d in rig.devices.items()}
            arms = [link for link in links.values() if isinstance(link, Arm)]
            if arms:
                trajectory = single_trajectory(rig)
                self.total = duration_of(trajectory)
                check_recorded_motion(rig, trajectory)
                for arm in arms:
                    stack.callback(arm.stop)
                    check_force_control(arm, trajectory)
                    arm.follow(trajectory)
            else:
                durations = [d.duration for d in rig.devices.values() if d.duration is not None]
                self.total = max(durations, default=None)
            for arrival in merge_batches(links, rig.devices):
                self._take([arrival])
                if self._interrupt.reason is not None:
                    return

    def _run_live(self) -> None:
        rig = self._rig
        trajectory = single_trajectory(rig) if rig.trajectories else None
        if trajectory is not None:
            check_live_motion(rig, trajectory)
        began, before = clock().now(), clock().processor_time()
        guard = Guard(rig.safety, rig.ports)
        with ExitStack() as stack:
            facts = self.facts = LiveFacts(stack.enter_context(real_time_section(self._interrupt.stop)))
            self.links = connect_devices(rig, stack)
            live = LiveRun(rig, self.links, guard, trajectory, self._take, self._interrupt)

            def account() -> None:
                facts.motion = motion_facts(self.links, live.links.largest_backlog, guard)

            stack.callback(account)
            for arm in live.arms.values():
                stack.callback(arm.stop)
            stack.callback(live.links.stop)
            stack.callback(guard.close)
            self.guard = guard
            self._interrupt.trips(guard.trip)
            live.links.start()
            try:
                self._pass_states(live, facts)
            finally:
                guard.close()
                live.links.stop()
                for arrivals in live.links.remaining():
                    live.pass_on(arrivals)
        # Children that have ended count as well; what the devices did is all in here.
        used = clock().processor_time() - before
        facts.cpu_cores = used / max(clock().now() - began, 1e-9)
        if guard.reason is not None and self._interrupt.reason is None:
            raise DeviceError(guard.reason)

    def _pass_states(self, live: LiveRun, facts: LiveFacts) -> None:
        """Standstill, ready, moving; until the arms are done or something stops the run."""
        facts.standstill = stand_still(live, self._noise)
        if facts.standstill is None:
            return
        facts.offset = compensable_offset(live)
        facts.retreat = get_ready(live, facts.standstill, facts.offset)
        if live.is_stopped:
            return
        if live.arms and live.trajectory is not None:
            self.total = duration_of(live.trajectory) + live.standstill
        move(live, facts.retreat)
