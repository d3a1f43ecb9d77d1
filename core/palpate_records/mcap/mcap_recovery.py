"""Recovery: the undamaged part of an MCAP log, in a new complete log."""

from __future__ import annotations

import itertools
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np
from palpate import LogError, OutputError

from palpate_records.mcap import mcap_records as records
from palpate_records.mcap.mcap_copy import NewLog, PackedChunk, compress_chunk
from palpate_records.mcap.mcap_definitions import Definitions
from palpate_records.mcap.mcap_extras import Attachment, read_attachment, read_metadata
from palpate_records.mcap.mcap_file import McapFile
from palpate_records.mcap.mcap_records import Block, ChunkPiece
from palpate_records.messages.topics import Bytes, Stamps
from palpate_records.progress import Progress, silent
from palpate_records.temporary_folders import scratch

_NEW_LOG = "new.mcap"
_NANOSECONDS = 1e9  # in a second


def recover_mcap(path: Path, out: Path, beside: Mapping[str, str] = {}, progress: Progress = silent) -> str:
    """Write the undamaged part of a log into a new file; return a sentence on its size. Raises LogError, OutputError.

    Documents of the run that a log of palpate has lost are taken from those `beside` it, by name.
    """
    if out.exists():
        raise OutputError(f"{out}: exists already, and nothing is ever overwritten")
    log = McapFile(path, accept_cut=True)
    is_of_palpate = any("palpate" in topic.metadata for topic in log.topics.values())
    try:
        # The new log is complete before it gets its name.
        with scratch(out.parent) as folder:
            recovered = _write_log(log, folder, beside if is_of_palpate else {}, progress)
            if not recovered.messages:
                raise LogError(f"{path}: nothing in it is undamaged")
            if out.exists():
                raise OutputError(f"{out}: exists by now, and nothing is ever overwritten")
            (folder / _NEW_LOG).rename(out)
    except OSError as error:
        raise OutputError(f"{out}: cannot write: {error.strerror}") from error
    first, last = recovered.log.span
    sentence = f"{recovered.messages} messages over {(last - first) / _NANOSECONDS:.3f} s are in {out}"
    if recovered.documents:
        sentence += f", with {' and '.join(recovered.documents)} from next to {path}, which has none that is whole"
    if log.complete:
        return f"the log was whole: {sentence}"
    return f"{sentence}; {log.report.words() if log.report else 'its end was missing'}"


def _write_log(log: McapFile, folder: Path, beside: Mapping[str, str], progress: Progress) -> _RecoveredLog:
    """Write the whole messages of a log, its attachments and metadata into a new one in a folder; return it."""
    with log.path.open("rb") as old, (folder / _NEW_LOG).open("xb") as file, (folder / "index").open("x+b") as index:
        recovered = _RecoveredLog(NewLog(file, index), old, beside)
        definitions = Definitions(extras=[])
        for definitions, block in log.everything():
            recovered.write_extras(definitions)  # before the messages, where a replay reads them
            recovered.write_block(definitions, block)
            progress(recovered.messages)
        recovered.write_extras(definitions)
        recovered.log.finish()
        file.flush()
        os.fsync(file.fileno())
    return recovered


@dataclass
class _RecoveredLog:
    """The new log, and the old one."""

    log: NewLog
    old: IO[bytes]
    beside: Mapping[str, str]  # documents of the run by name, for those that the old log has lost
    messages: int = 0
    documents: list[str] = field(default_factory=list)  # names of those from the folder of the old log

    def write_block(self, definitions: Definitions, block: Block) -> None:
        """Write the messages of a block whose channels are defined."""
        for identity in np.flatnonzero(block.counts).tolist():
            if identity in definitions.channels and identity not in self.log:
                self.log.define(identity, definitions.channels[identity], definitions.schema_of(identity) or 0)
        # The rows of each chunk of the block.
        pieces = block.pieces or (None,)
        begins = [piece.begin for piece in block.pieces] or [0]
        edges = [*np.searchsorted(block.offsets, begins).tolist(), len(block)]
        for piece, (first, last) in zip(pieces, itertools.pairwise(edges), strict=True):
            self._write_rows(definitions, block, slice(first, last), piece)

    def _write_rows(self, definitions: Definitions, block: Block, rows: slice, piece: ChunkPiece | None) -> None:
        """Write successive messages, `rows` of a block: as their chunk is, if no definition is lost, else as a new one.

        `piece` is where the old file has their chunk; None for messages outside chunks.
        """
        channel = block.channel[rows]
        logged = block.logged[rows].view("<u8")
        offsets = block.offsets[rows]
        channels = np.unique(channel).tolist()
        # A chunk is copied as it is unless some of its messages cannot be read without a lost definition.
        if piece is not None and all(_is_defined(definitions, identity) for identity in channels):
            self.old.seek(piece.place)
            packed = PackedChunk.of(self.old.read(piece.length))
            offsets = offsets - piece.begin
        else:
            is_defined = np.isin(channel, [identity for identity in channels if identity in self.log])
            channel = channel[is_defined]
            logged = logged[is_defined]
            lengths = block.lengths[rows][is_defined] + records.HEAD
            data, offsets = _gather_records(block.buffer, offsets[is_defined], lengths)
            packed = compress_chunk(data)
        if len(offsets):
            self.log.chunk(packed, channel, logged, offsets)
            self.messages += len(offsets)

    def write_extras(self, definitions: Definitions) -> None:
        """Write the whole attachments and metadata read so far, and before the first message those next to the log."""
        names = {self._write_extra(opcode, content) for opcode, content in definitions.take_extras()}
        for name, text in self.beside.items():
            if not self.messages and name not in names and name not in self.documents:
                self.log.attachment(Attachment(0, 0, name, "application/toml", text.encode()))
                self.documents.append(name)

    def _write_extra(self, opcode: int, content: bytes) -> str | None:
        """Write an attachment or metadata; return the name of an attachment, None for metadata and damaged ones."""
        try:
            if opcode == records.METADATA:
                name, entries = read_metadata(content)
                self.log.metadata(name, entries)
                return None
            attachment = read_attachment(content)
        except records.Damage:
            return None  # messages are recovered without it
        self.log.attachment(attachment)
        return attachment.name


def _is_defined(definitions: Definitions, channel: int) -> bool:
    """Return True if a channel and its schema are defined."""
    return channel in definitions.channels and definitions.schema_of(channel) is not None


def _gather_records(buffer: Bytes, offsets: Stamps, lengths: Stamps) -> tuple[bytes, Stamps]:
    """Return records one after the other, and their new offsets (n,); successive ones are copied together."""
    ends = offsets + lengths
    breaks = np.flatnonzero(offsets[1:] != ends[:-1]) + 1
    runs = zip([0, *breaks.tolist()], [*breaks.tolist(), len(offsets)], strict=True)
    data = b"".join(buffer[offsets[first] : ends[last - 1]].tobytes() for first, last in runs if last > first)
    return data, np.cumsum(lengths) - lengths


def count_messages(path: Path) -> tuple[int, float]:
    """Return the number of whole messages of a damaged log, and the time [s] from the first to the last."""
    log = McapFile(path, accept_cut=True)
    count = 0
    first_stamps, last_stamps = [], []
    for _, messages in log.blocks(set(log.topics)):
        count += len(messages)
        first_stamps.append(int(messages.logged.min()))
        last_stamps.append(int(messages.logged.max()))
    return count, (max(last_stamps) - min(first_stamps)) / _NANOSECONDS if first_stamps else 0.0
