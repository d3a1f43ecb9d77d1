"""Batches as they arrive from devices, checked and in the order of time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate.device import Batch, Device, Link, Stream
from palpate.errors import RAISED_BY_PARTS, DeviceError, PalpateError, PluginError, error_in, suggest
from palpate.offers import context_of
from palpate.vectors import read_only

Arrivals = Sequence[tuple[str, Batch]]  # batches that arrived together, each with its device


@dataclass(frozen=True)
class Progress:
    """The time up to which a record has become samples, and by which the estimates are behind."""

    sampled: float  # [s]
    behind: float = 0.0  # [s] that the estimates are behind the samples


Take = Callable[[Arrivals], Progress | None]  # None: no samples are made of them


def each(take: Callable[[str, Batch], None]) -> Take:
    """Return a function that passes batches on one by one, for those who make no samples of them."""

    def take_all(arrivals: Arrivals) -> None:
        for device, batch in arrivals:
            take(device, batch)

    return take_all


@contextmanager
def open_link(name: str, device: Device, seed: int) -> Iterator[Link]:
    """Connect a device for as long as the context; raises PluginError where its class returns anything but a link."""
    source = f"device {name}: {type(device).__name__}.connect"
    with context_of(device.connect(seed), source) as link:
        if not callable(getattr(link, "batches", None)):
            raise PluginError(f"{source} gives {link!r}, which is not a link: it has no method `batches`")
        yield link


def declared_batches(name: str, link: Link, streams: Sequence[Stream]) -> Iterator[Batch]:
    """Yield the batches of a device, read-only.

    Raises DeviceError, with the place, for what it has not declared or itself raises.
    """
    widths = {stream.name: len(stream.channels) for stream in streams}
    answer = link.batches()
    if not isinstance(answer, Iterable):
        raise PluginError(f"device {name}: {type(link).__name__}.batches returns {answer!r}, not an iterator of Batch")
    batches = iter(answer)
    while True:
        try:
            batch = next(batches, None)
        except PalpateError:
            raise
        except RAISED_BY_PARTS as error:  # whatever a stranger's device raises
            raise DeviceError(f"device {name} failed: {error_in(error)}") from error
        if batch is None:
            return
        # The stream has to be declared, with whole nanoseconds and a value for each channel.
        if not isinstance(batch, Batch):
            raise PluginError(f"device {name} sends {batch!r}, not a Batch")
        if batch.stream not in widths:
            raise DeviceError(f"device {name} sends a stream {batch.stream!r}{suggest(batch.stream, widths)}")
        for stamps in (batch.time, batch.received):
            if np.asarray(stamps).dtype != np.int64:
                raise DeviceError(
                    f"device {name} sends a time-stamp in the stream {batch.stream!r} that is not a whole number of "
                    f"nanoseconds: {_first_odd(np.asarray(stamps))}"
                )
        shape = (len(batch.time), widths[batch.stream])
        if np.shape(batch.values) != shape:
            shapes = f"values of shape {np.shape(batch.values)} in place of {shape}"
            raise DeviceError(f"device {name} sends {shapes} in the stream {batch.stream!r}")
        yield read_only(batch)


def _first_odd(stamps: NDArray[Any]) -> Any:
    """Return the first of some time-stamps that is not a finite number; the first of all where each is one."""
    odd = [stamp for stamp in stamps.ravel().tolist() if not (isinstance(stamp, int | float) and math.isfinite(stamp))]
    return next(iter(odd or stamps.ravel().tolist()), f"none, of type {stamps.dtype}")


def merge_batches(links: Mapping[str, Link], devices: Mapping[str, Device]) -> Iterator[tuple[str, Batch]]:
    """Yield the batches of all links, always from the one that is furthest behind in time.

    Raises like `declared_batches`.
    """
    sources = {name: declared_batches(name, link, devices[name].streams) for name, link in links.items()}
    heads: dict[str, Batch] = {}  # the next batch of each device
    while True:
        # The next batch of the devices that have none waiting; those at their end drop out.
        for name in tuple(sources):
            if name in heads:
                continue
            head = next((batch for batch in sources[name] if len(batch.time)), None)
            if head is None:
                del sources[name]
            else:
                heads[name] = head
        if not heads:
            return
        earliest = min(heads, key=lambda device: int(heads[device].received[0]))
        yield earliest, heads.pop(earliest)
