"""How batches flow: as fast as they are read, or in real time."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from typing import TYPE_CHECKING

from palpate.device import Arm, Link, is_live
from palpate.trajectory import duration_of

from palpate_engine.pipeline.approach import check_force_control
from palpate_engine.pipeline.arrivals import Take, merge_batches
from palpate_engine.pipeline.interrupt import Interrupt
from palpate_engine.pipeline.planned_motion import check_recorded_motion, single_trajectory
from palpate_engine.pipeline.rig import Rig

if TYPE_CHECKING:
    from palpate_engine.pipeline.live.guard import Guard
    from palpate_engine.pipeline.live.live_facts import LiveFacts
    from palpate_engine.pipeline.live.standstill import Noise


class Flow:
    """Passes each batch to `take`, and collects the facts of a live run."""

    def __init__(self, rig: Rig, take: Take, interrupt: Interrupt, noise: Noise | None = None) -> None:
        self.rig, self.take, self.interrupt, self.noise = rig, take, interrupt, noise or {}
        self.total: float | None = None  # [s] how long it takes, where that is known
        self.facts: LiveFacts | None = None  # of a live run
        self.guard: Guard | None = None  # of a live run
        self.links: Mapping[str, Link] = {}  # of a live run

    def run(self) -> None:
        """Connect, set in motion, and pass every batch on until there are no more."""
        if is_live(self.rig.devices):
            from palpate_engine.pipeline.live.live_flow import run_live  # a replay loads nothing of a live run

            run_live(self)
        else:
            self._run_read()

    def _run_read(self) -> None:
        rig = self.rig
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
                self.take([arrival])
                if self.interrupt.reason is not None:
                    return
