"""The samples of a run, for an analysis that continues with them in memory."""

from __future__ import annotations

from dataclasses import dataclass, field

from palpate import Batch, Estimates, Samples


@dataclass
class SampleObserver:
    """An observer of a run that keeps its samples, and the latest block of estimates of each track: all of a fit's."""

    blocks: list[Samples] = field(default_factory=list)
    found: dict[str, Estimates] = field(default_factory=dict)

    def batch(self, device: str, batch: Batch) -> None:
        """Raw readings are not kept."""

    def samples(self, samples: Samples) -> None:
        """Keep a block."""
        self.blocks.append(samples)

    def estimates(self, track: str, estimates: Estimates) -> None:
        """Keep a block in place of the one before."""
        self.found[track] = estimates
