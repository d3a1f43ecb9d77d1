"""Readings and samples of a record, before any model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from palpate import Batch, Samples
from palpate_engine import RecordTracks, Source, build_parts, build_pipeline

from palpate_notebook.run_functions import quietly


def samples_of(source: Source) -> Samples:
    """Return the aligned samples of the pipeline of a record; raises ConfigurationError, LogError."""
    pipeline = build_pipeline(source, estimates=False)
    with quietly():
        return RecordTracks(pipeline).estimate().samples


def readings_of(source: Source) -> dict[str, Batch]:
    """Return all readings of each stream as the devices send them, without alignment, by "device.stream".

    Raises ConfigurationError for a device that no plugin has, LogError where a log cannot be read.
    """
    by_stream: dict[str, list[Batch]] = {}
    for device_name, device in build_parts(source, "device").items():
        with device.connect(0) as link:
            for batch in link.batches():
                name = ".".join(part for part in (device_name, batch.stream) if part)
                by_stream.setdefault(name, []).append(batch)
    return {name: _concatenated(batches) for name, batches in by_stream.items()}


def _concatenated(batches: Sequence[Batch]) -> Batch:
    """Return the batches of one stream, in their order, as one."""
    columns = [np.concatenate([getattr(batch, key) for batch in batches]) for key in ("time", "received", "values")]
    return Batch(batches[0].stream, *columns)
