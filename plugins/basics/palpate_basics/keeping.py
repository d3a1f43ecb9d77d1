"""The samples of a run, for an analysis that wants nothing else of it."""

from __future__ import annotations

from dataclasses import dataclass, field

from palpate import Batch, Estimates, Samples


@dataclass
class KeptSamples:
    """An observer of a run that keeps its samples."""

    blocks: list[Samples] = field(default_factory=list)

    def batch(self, device: str, batch: Batch) -> None:
        """Raw readings are not kept."""

    def samples(self, samples: Samples) -> None:
        """Keep a block."""
        self.blocks.append(samples)

    def estimates(self, track: str, estimates: Estimates) -> None:
        """Values are in the result."""
