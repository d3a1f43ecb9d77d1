"""Flow of a run's batches: what it asks of it, and what it learns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from palpate.device import Link

from palpate_engine.pipeline.arrivals import Take
from palpate_engine.pipeline.interrupt import Interrupt
from palpate_engine.pipeline.rig import Rig

if TYPE_CHECKING:
    from palpate_engine.pipeline.live.guard import Guard
    from palpate_engine.pipeline.live.live_facts import LiveFacts
    from palpate_engine.pipeline.live.standstill import Noise


class Flow:
    """Batches on their way from the devices to `take`, and the facts of a live run; `run_flow` passes them on."""

    def __init__(self, rig: Rig, take: Take, interrupt: Interrupt, noise: Noise | None = None) -> None:
        self.rig, self.take, self.interrupt, self.noise = rig, take, interrupt, noise or {}
        self.total: float | None = None  # [s] how long it takes, where that is known
        self.facts: LiveFacts | None = None  # of a live run
        self.guard: Guard | None = None  # of a live run
        self.links: Mapping[str, Link] = {}  # of a live run
