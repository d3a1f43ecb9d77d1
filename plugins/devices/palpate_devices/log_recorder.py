"""The log of a run as MCAP: channels, messages and metadata, flushed and synced as it grows."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray
from palpate import Batch, Estimates, Floats, Run, Samples, Stream, Thread, clock

from palpate_devices.log_file import Bookmark, LogFile
from palpate_devices.mcap_blocks import add_messages
from palpate_devices.mcap_index import keep_index_in
from palpate_devices.messages import LOG_SCHEMA, STANDARD, MessageType, numbers_type, pack_messages

# Choices.
FLUSH_EVERY = 0.15  # [s]; with what is on its way, a kill costs some 0.05 s more, on a busy machine twice that
_FLUSH_FROM = 1 << 18  # [bytes]; a replay writes that much sooner, and a full disk costs no more of it
_SYNC_EVERY = 1.0  # [s]; the most that a power cut costs
_BLOCK = 1 << 14  # messages that are made at once, which bounds the memory
_SAMPLE_FIELDS = ("time", "interval", "force", "position", "velocity", "contact", "active")
_PLACE = ("x", "y")


class LogRecorder:
    """The MCAP file of a run, open for writing; used by one thread at a time."""

    def __init__(self, file: LogFile, run: Run, index: IO[bytes]) -> None:
        """Write the channels of a run, its facts and documents; the index of the chunks goes to a file of its own."""
        from mcap.writer import CompressionType, Writer

        self._file = file
        self._log: Any = Writer(cast(Any, file), compression=CompressionType.ZSTD)
        keep_index_in(self._log, index)
        self._log.start(profile="ros2", library=f"palpate {run.facts.get('palpate', '')}")
        # Channels of raw streams, by device and stream, of samples, and of every track; each is known by its number.
        self._schemas: dict[str, int] = {}
        self._streams: dict[tuple[str, str], tuple[int, Stream]] = {}
        for device, streams in run.streams.items():
            for stream in streams:
                self._streams[device, stream.name] = self._raw_channel(device, stream), stream
        self._samples = self._channel("/palpate/samples", numbers_type("Samples", (*_SAMPLE_FIELDS, *_PLACE)))
        self._tracks = {}
        for track, parameters in run.tracks.items():
            names = [parameter.name for parameter in parameters]
            estimate_type = numbers_type(_type_name(track), _estimate_fields(names))
            self._tracks[track] = self._channel(f"/palpate/estimates/{track}", estimate_type)
        # Facts and documents of the run; up to here the log is whole.
        self._log.add_metadata("palpate", {"schema": str(LOG_SCHEMA), **run.facts})
        for name, text in run.documents.items():
            self._log.add_attachment(0, 0, name, "application/toml", text.encode())
        self._whole = Bookmark(self._log, file)
        self._flushed = self._synced = clock().now()
        self._syncing: Thread | None = None
        self._unsynced: OSError | None = None

    def _raw_channel(self, device: str, stream: Stream) -> int:
        """Add the channel of a device's stream, with the facts that a replay needs; return its number."""
        message_type = STANDARD.get(stream.layout) or _own_type(device, stream)
        topic = f"/{device}/{stream.name}" if stream.name else f"/{device}"
        return self._channel(topic, message_type, {"palpate": json.dumps(_facts(device, stream))})

    def _channel(self, topic: str, message_type: MessageType, facts: dict[str, str] | None = None) -> int:
        """Add a channel, and its schema where that is new; return its number."""
        name = message_type.name
        if name not in self._schemas:
            self._schemas[name] = self._log.register_schema(name, "ros2msg", message_type.definition.encode())
        return int(self._log.register_channel(topic, "cdr", self._schemas[name], facts or {}))

    def mark(self, facts: Mapping[str, str]) -> None:
        """Add facts of the run's outcome as metadata."""
        self._log.add_metadata("palpate result", dict(facts))

    def batch(self, device: str, batch: Batch) -> None:
        """Add raw readings as messages of their stream."""
        channel, stream = self._streams[device, batch.stream]
        names = [entry.name for entry in stream.channels]
        joints = tuple(names[: len(names) // 2]) if stream.layout == "joints" else ()  # angles, then as many speeds
        self._write(
            channel,
            stamps=batch.time,
            logged=batch.received,
            frame=stream.frame or device,
            numbers=batch.values,
            joints=joints,
        )

    def samples(self, samples: Samples) -> None:
        """Add aligned samples."""
        columns = [np.asarray(getattr(samples, name), float) for name in _SAMPLE_FIELDS]
        numbers = np.column_stack([*columns, samples.lateral])
        self._write(self._samples, samples.stamp, samples.stamp, "surface", numbers)

    def estimates(self, track: str, estimates: Estimates, stamps: NDArray[np.int64], lateral: Floats) -> None:
        """Add estimates of samples with these stamps (n,) [ns] and places (n, 2) [m]."""
        # In the order of `_estimate_fields`.
        columns = (
            estimates.time,
            estimates.values,
            estimates.std,
            estimates.surface,
            estimates.surface_std,
            estimates.force,
            estimates.nis,
            estimates.status.astype(float),
            lateral,
            estimates.innovation,
        )
        # In blocks: those of an offline estimator are of the whole record.
        for begin in range(0, len(stamps), _BLOCK):
            rows = slice(begin, begin + _BLOCK)
            numbers = np.column_stack([column[rows] for column in columns])
            self._write(self._tracks[track], stamps[rows], stamps[rows], "surface", numbers)

    def _write(
        self,
        channel: int,
        stamps: NDArray[np.int64],
        logged: NDArray[np.int64],
        frame: str,
        numbers: Floats,
        joints: tuple[str, ...] = (),
    ) -> None:
        """Add a message for each stamp (n,) [ns] and row of numbers (n, k) to a channel, logged at times (n,) [ns]."""
        add_messages(self._log, channel, logged, stamps, pack_messages(stamps, frame, numbers, joints))

    def save(self) -> None:
        """Flush every 0.15 s, and sync every second in a thread; raises OSError, also that of the latest sync."""
        now = clock().now()
        if now - self._flushed < FLUSH_EVERY and self._file.unmarked() < _FLUSH_FROM:
            return
        self._log.flush()
        self._whole.set()
        self._flushed = now
        if self._unsynced is not None:
            raise self._unsynced
        if now - self._synced >= _SYNC_EVERY and not (self._syncing is not None and self._syncing.is_alive()):
            self._syncing = clock().thread(self._sync, "mcap sync")
            self._syncing.start()
            self._synced = now

    def _sync(self) -> None:
        """Sync the file: a busy disk takes some 0.3 s for this, during which the writer must keep flushing."""
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            self._unsynced = error

    def finish(self) -> None:
        """Write index and summary; raises OSError."""
        if self._syncing is not None:
            self._syncing.join()
        self._log.finish()
        self._file.flush()
        os.fsync(self._file.fileno())

    def close_early(self) -> None:
        """End the log with its last whole chunk; raises OSError."""
        if self._syncing is not None:
            self._syncing.join()
        self._whole.close()
        os.fsync(self._file.fileno())


def _facts(device: str, stream: Stream) -> dict[str, Any]:
    """Return the facts of a stream that a replay needs and its messages do not state."""
    return {
        "schema": LOG_SCHEMA,
        "device": device,
        "stream": stream.name,
        "rate": stream.rate,
        "layout": stream.layout,
        "frame": stream.frame,
        "channels": [channel.name for channel in stream.channels],
        "units": [channel.unit for channel in stream.channels],
        "limits": [channel.limits for channel in stream.channels],
    }


def _own_type(device: str, stream: Stream) -> MessageType:
    """Return the type of a stream that has no standard message, named after device and stream."""
    name = "Setpoint" if stream.layout == "setpoint" else _type_name(f"{device} {stream.name}")
    return numbers_type(name, [channel.name for channel in stream.channels])


def _type_name(text: str) -> str:
    """Return a text as the name of a type: its letters and digits, each run of them capitalised."""
    runs = re.findall(r"[^\W_]+", text)
    return "".join(run[:1].upper() + run[1:] for run in runs) or "Numbers"


def _estimate_fields(names: Sequence[str]) -> list[str]:
    """Return the fields of a track's messages, for parameters of these names."""
    return [
        "time",
        *names,
        *(f"{name}_std" for name in names),
        "surface",
        "surface_std",
        "force",
        "nis",
        "status",
        *_PLACE,
        "innovation",
    ]
