"""Records from tables of pandas, whose columns are recognised like those of a file."""

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


def record_of(data: Any, signals: Mapping[str, str | float] | None = None) -> Record:
    """Return the record of a record itself, of a log by its path, or of a table of pandas.

    The columns of a table are recognised by their names and numbers, as those of a CSV file (``force_N``,
    ``height [mm]``); units may also be in ``frame.attrs["units"]``. `signals` as in `palpate.read`. Raises
    ConfigurationError, LogError.
    """
    if isinstance(data, Record):
        return data
    if isinstance(data, str | Path):
        return read(data, signals)
    if not (hasattr(data, "to_csv") and hasattr(data, "columns")):
        remedy = "palpate.read(path) makes one of a file, palpate.record(...) of arrays"
        raise ConfigurationError(f"a {type(data).__name__} is not a record: {remedy}")
    return _frame_record(data, signals)


def _frame_record(frame: Any, signals: Mapping[str, str | float] | None) -> Record:
    """Return the record of a table of pandas: it is written as a CSV file and read like one, then kept in memory."""
    units = frame.attrs.get("units", {})
    labelled = frame.rename(columns={name: f"{name} [{unit}]" for name, unit in units.items()})
    with TemporaryDirectory(prefix="palpate-") as folder:
        path = Path(folder) / "table.csv"
        labelled.to_csv(path, index=frame.index.name is not None)
        try:
            log_record = read(path, signals)
        except LogError as error:
            raise LogError(str(error).replace(str(path), "table")) from error
        source = source_of(log_record.name, log_record.path, {"device": dict(log_record.devices)})
        digest, columns = register_readings(_read_columns(source))
    # The same alignment, with the record in memory in place of the log.
    (log_name,) = log_record.devices
    alignment = {key: _with_memory_device(entry, log_name) for key, entry in log_record.alignment.items()}
    return Record(
        name="table",
        devices={_DEVICE: {"type": "memory-record", "sha256": digest}},
        alignment=alignment,
        doubts=log_record.doubts,
        columns=columns,
        assumed=tuple(key for key in log_record.assumed if key.startswith("alignment.")),
    )


def _read_columns(source: Source) -> NamedColumns:
    """Return the readings of a log of one device with one stream."""
    (device,) = build_parts(source, "device").values()
    with device.connect(0) as link:
        batches = list(link.batches())
    return NamedColumns(
        time=np.concatenate([batch.time for batch in batches]),
        values=np.concatenate([batch.values for batch in batches]),
        channels=tuple((channel.name, channel.unit) for channel in device.streams[0].channels),
    )


def _with_memory_device(entry: Any, log_name: str) -> Any:
    """Return an entry of the alignment with the device in memory in place of the log, if it names a channel."""
    if isinstance(entry, Mapping) and "channel" in entry:
        return {**entry, "channel": _with_memory_device(entry["channel"], log_name)}
    if isinstance(entry, str) and entry.startswith(f"{log_name}."):
        return f"{_DEVICE}{entry.removeprefix(log_name)}"
    return entry
