"""Readings and samples of a record, before any model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from palpate import Batch, Samples
from palpate_engine import RecordTracks, Source, build_parts, build_pipeline

from palpate_notebook.run_functions import quietly


def samples_of(source: Source) -> Samples:
    """Return the samples of a record by the pipeline of its devices and alignment; raises ConfigurationError,
    LogError."""
    pipeline = build_pipeline(source, estimates=False)
    with quietly():
        return RecordTracks(pipeline).estimate().samples


def readings_of(source: Source) -> dict[str, Batch]:
    """Return all readings of each stream as the devices send them, by "device.stream"; no alignment has a say in them.

    Raises ConfigurationError for a device that no plugin has, LogError where a log cannot be read.
    """
    devices = build_parts(source, "device")
    found: dict[str, list[Batch]] = {}
    for name, device in devices.items():
        with device.connect(0) as link:
            for batch in link.batches():
                found.setdefault(".".join(part for part in (name, batch.stream) if part), []).append(batch)
    return {name: _joined(batches) for name, batches in found.items()}


def _joined(batches: Sequence[Batch]) -> Batch:
    """One batch from those of a stream in their order."""
    columns = [np.concatenate([getattr(batch, key) for batch in batches]) for key in ("time", "received", "values")]
    return Batch(batches[0].stream, *columns)
