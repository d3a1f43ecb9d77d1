"""Records from tables of pandas: their columns are recognised as those of a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from palpate import ConfigurationError, LogError
from palpate_engine import Source, build_parts

from palpate_notebook.memory_device import NamedColumns, register_readings
from palpate_notebook.part_tables import source_of
from palpate_notebook.record_from_log import read
from palpate_notebook.record_object import Record

_DEVICE = "record"


def record_of(given: Any, signals: Mapping[str, str | float] | None = None) -> Record:
    """Return a record as it is, one of a log by its path, or one of a table of pandas.

    The columns of a table are recognised by their names and numbers, as those of a CSV file (``force_N``,
    ``height [mm]``); units may also be in ``frame.attrs["units"]``. `signals` as in `palpate.read`. Raises
    ConfigurationError, LogError.
    """
    if isinstance(given, Record):
        return given
    if isinstance(given, str | Path):
        return read(given, signals)
    if not (hasattr(given, "to_csv") and hasattr(given, "columns")):
        made = "palpate.read(path) makes one of a file, palpate.record(...) of arrays"
        raise ConfigurationError(f"a {type(given).__name__} is not a record: {made}")
    return _of_frame(given, signals)


def _of_frame(frame: Any, signals: Mapping[str, str | float] | None) -> Record:
    units = frame.attrs.get("units", {})
    named = frame.rename(columns={name: f"{name} [{unit}]" for name, unit in units.items()})
    with TemporaryDirectory(prefix="palpate-") as place:
        path = Path(place) / "table.csv"
        named.to_csv(path, index=frame.index.name is not None)
        try:
            found = read(path, signals)
        except LogError as error:
            raise LogError(str(error).replace(str(path), "table")) from error
        readings, names = _readings(source_of(found.name, found.path, {"device": dict(found.devices)}))
    digest, kept = register_readings(NamedColumns(*readings, names))
    (device,) = found.devices
    alignment = {role: _moved(signal, device) for role, signal in found.alignment.items()}
    assumed = tuple(key for key in found.assumed if key.startswith("alignment."))
    return Record(
        "table", {_DEVICE: {"type": "memory-record", "sha256": digest}}, alignment, doubts=found.doubts, columns=kept,
        assumed=assumed,
    )  # fmt: skip


def _readings(source: Source) -> tuple[tuple[Any, Any], tuple[tuple[str, str], ...]]:
    """Time-stamps and values of the one stream of a log, with names and units of its channels."""
    (device,) = build_parts(source, "device").values()
    with device.connect(0) as link:
        batches = list(link.batches())
    names = tuple((channel.name, channel.unit) for channel in device.streams[0].channels)
    columns = [np.concatenate([getattr(batch, key) for batch in batches]) for key in ("time", "values")]
    return (columns[0], columns[1]), names


def _moved(signal: Any, device: str) -> Any:
    """Return a signal of the alignment whose channel is one of the record in memory."""
    if isinstance(signal, Mapping) and "channel" in signal:
        return {**signal, "channel": _moved(signal["channel"], device)}
    return (
        f"{_DEVICE}{signal.removeprefix(device)}"
        if isinstance(signal, str) and signal.startswith(f"{device}.")
        else signal
    )
