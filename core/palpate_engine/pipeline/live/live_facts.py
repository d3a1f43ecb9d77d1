"""Facts of a live run: ``run.live`` of ``result.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from palpate.device import Link, ReportsHealth

from palpate_engine.pipeline.live.guard import Guard
from palpate_engine.pipeline.live.retreat_check import RetreatCheck
from palpate_engine.pipeline.live.standstill import Standstill
from palpate_engine.pipeline.live.stored_offset import Offset
from palpate_engine.result import finite_tree


@dataclass(frozen=True)
class MotionFacts:
    """Facts of links and guard when the motion is over, however it ended."""

    devices: Mapping[str, Any]  # health by name
    largest_backlog: int  # pieces of readings that waited
    peak_force: float  # [N] largest tared reading
    peak_force_untared: float  # [N]
    ended_early: tuple[str, ...]  # devices that no safety check needs
    stop: tuple[str, float] | None  # why and when, monotonic [s], the guard tripped

    def table(self) -> dict[str, Any]:
        """As in ``result.json``."""
        table: dict[str, Any] = {
            "devices": self.devices,
            "largest_backlog": self.largest_backlog,
            "peak_force": self.peak_force,
            "peak_force_untared": self.peak_force_untared,
        }
        if self.ended_early:
            table["ended_early"] = list(self.ended_early)
        if self.stop is not None:
            table["stop"] = {"reason": self.stop[0], "monotonic": self.stop[1]}
        return table


@dataclass(frozen=True)
class EstimateFacts:
    """Facts of how late the estimates were."""

    latency: Mapping[str, Any] | None
    largest_behind: float  # [s] behind the readings
    until: float | None  # [s] at which they were given up; None: all were made

    def table(self) -> dict[str, Any]:
        """As in ``result.json``."""
        return {"latency": self.latency, "largest_behind": self.largest_behind, "until": self.until}


@dataclass
class LiveFacts:
    """A part for each state of a live run, None where it was not reached."""

    scheduling: str  # priority of its threads
    standstill: Standstill | None = None
    offset: Offset | None = None  # as stored; None where none was stored
    retreat: RetreatCheck | None = None  # None where no arm can
    motion: MotionFacts | None = None
    cpu_cores: float | None = None  # that this process and its children kept busy
    estimates: EstimateFacts | None = None

    def table(self) -> dict[str, Any]:
        """As in ``result.json``."""
        table: dict[str, Any] = {"scheduling": self.scheduling}
        for name, part in (("standstill", self.standstill), ("offset", self.offset), ("felt", self.retreat)):
            if part is not None:
                table[name] = part.table()
        if self.motion is not None:
            table |= self.motion.table()
        if self.cpu_cores is not None:
            table["cpu_cores"] = self.cpu_cores
        if self.estimates is not None:
            table["estimates"] = self.estimates.table()
        return table


def motion_facts(links: Mapping[str, Link], largest_backlog: int, guard: Guard) -> MotionFacts:
    """Return the facts of a motion that is over, while its links are still there."""
    return MotionFacts(
        devices={name: finite_tree(link.health) for name, link in links.items() if isinstance(link, ReportsHealth)},
        largest_backlog=largest_backlog,
        peak_force=guard.peak.tared,
        peak_force_untared=guard.peak.untared,
        ended_early=tuple(sorted(guard.ended_early)),
        stop=None if guard.account is None or guard.stop.tripped is None else (guard.account, guard.stop.tripped),
    )
