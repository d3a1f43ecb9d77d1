"""Batches as they arrive, and who takes them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from palpate.device import Batch, Link

Arrivals = Sequence[tuple[str, Batch]]  # batches that arrived together, each with its device


@dataclass(frozen=True)
class Progress:
    """How far a record has become samples and estimates."""

    sampled: float  # [s]
    behind: float = 0.0  # [s] that the estimates are behind the samples


Take = Callable[[Arrivals], Progress | None]  # None: no samples are made of them


def each(take: Callable[[str, Batch], None]) -> Take:
    """Takes arrivals one by one, for those who make no samples of them."""

    def taken(arrivals: Arrivals) -> None:
        for device, batch in arrivals:
            take(device, batch)

    return taken


def merge_batches(links: Mapping[str, Link]) -> Iterator[tuple[str, Batch]]:
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
