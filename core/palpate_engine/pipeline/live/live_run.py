"""A live run at work: what the states of a run share."""

from __future__ import annotations

from collections.abc import Mapping

from palpate.device import Arm, Link
from palpate.trajectory import Trajectory

from palpate_engine.pipeline.arrivals import Arrivals, Take
from palpate_engine.pipeline.interrupt import Interrupt
from palpate_engine.pipeline.live.guard import Guard
from palpate_engine.pipeline.live.links import LiveLinks
from palpate_engine.pipeline.rig import Rig

_STANDSTILL = 1.0  # [s] without a [safety] table; the default of its `standstill`


class LiveRun:
    """A rig whose devices are connected, its guard, and the function that takes their batches."""

    def __init__(
        self,
        rig: Rig,
        links: Mapping[str, Link],
        guard: Guard,
        trajectory: Trajectory | None,
        take: Take,
        interrupt: Interrupt,
    ) -> None:
        """Take a rig, its links and guard, its motion, and the function `take` that records and estimates batches."""
        self.rig, self.guard, self.trajectory, self.interrupt = rig, guard, trajectory, interrupt
        self.arms = {name: link for name, link in links.items() if isinstance(link, Arm)}
        self.links = LiveLinks(links, rig.devices, guard)
        self.standstill = rig.safety.standstill if rig.safety else _STANDSTILL  # [s]
        self._take_arrivals = take
        self._failed = False  # True after an error of that function, such as a full disk
        self._sampled: float | None = None  # [s] length of the record that has become samples; None: none are made

    @property
    def is_stopped(self) -> bool:
        """True if the guard has tripped, or the run was interrupted."""
        return self.guard.reason is not None or self.interrupt.reason is not None

    @property
    def has_sampled_standstill(self) -> bool:
        """True if as much of the record as the standstill lasts has become samples, where any are made."""
        return self._sampled is None or self._sampled >= self.standstill

    def pass_on(self, arrivals: Arrivals) -> None:
        """Pass batches on to be recorded and estimated; those after a failure of that are dropped."""
        if self._failed:
            return
        try:
            progress = self._take_arrivals(arrivals)
        except BaseException:
            self._failed = True
            raise
        if progress is not None:
            self._sampled = progress.sampled
            self.links.behind = progress.behind > 0
