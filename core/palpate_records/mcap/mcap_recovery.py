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

_NEW = "new.mcap"


def recover_mcap(path: Path, out: Path, beside: Mapping[str, str] = {}, progress: Progress = silent) -> str:
    """Write the undamaged part of a log into a new file, and report how much that is; raises LogError, OutputError.

    Of the run's documents, those that a log of palpate's has lost are taken from the ones `beside` it, by name.
    """
    if out.exists():
        raise OutputError(f"{out}: exists already, and nothing is ever overwritten")
    log = McapFile(path, accept_cut=True)
    own = any("palpate" in topic.metadata for topic in log.topics.values())
    try:
        with scratch(out.parent) as folder:
            saved = _written(log, folder, beside if own else {}, progress)
            if not saved.messages:
                raise LogError(f"{path}: nothing in it is undamaged")
            if out.exists():
                raise OutputError(f"{out}: exists by now, and nothing is ever overwritten")
            (folder / _NEW).rename(out)
    except OSError as error:
        raise OutputError(f"{out}: cannot write: {error.strerror}") from error
    first, last = saved.log.span
    said = f"{saved.messages} messages over {(last - first) / 1e9:.3f} s are in {out}"
    if saved.taken:
        said += f", with {' and '.join(saved.taken)} from next to {path}, which has none that is whole"
    if log.complete:
        return f"the log was whole: {said}"
    return f"{said}; {log.report.words() if log.report else 'its end was missing'}"


def _written(log: McapFile, folder: Path, beside: Mapping[str, str], progress: Progress) -> _RecoveredLog:
    """Return the new log, in a folder."""
    with log.path.open("rb") as old, (folder / _NEW).open("xb") as file, (folder / "index").open("x+b") as index:
        saved = _RecoveredLog(NewLog(file, index), old, beside)
        known = Definitions(extras=[])
        for known, block in log.everything():
            saved.extras(known)  # ahead of the messages, where a replay looks for them
            saved.block(known, block)
            progress(saved.messages)
        saved.extras(known)
        saved.log.finish()
        file.flush()
        os.fsync(file.fileno())
    return saved


@dataclass
class _RecoveredLog:
    """The new log, and the old one."""

    log: NewLog
    old: IO[bytes]
    beside: Mapping[str, str]  # documents of the run by name, for those that the old log has lost
    messages: int = 0
    taken: list[str] = field(default_factory=list)  # documents from the folder of the old log

    def block(self, known: Definitions, block: Block) -> None:
        """Write the messages of a block whose channel is known."""
        for identity in np.flatnonzero(block.counts).tolist():
            if identity in known.channels and identity not in self.log:
                self.log.define(identity, known.channels[identity], known.schema_of(identity) or 0)
        pieces = block.pieces or (None,)
        begins = [piece.begin for piece in block.pieces] or [0]
        edges = [*np.searchsorted(block.offsets, begins).tolist(), len(block)]
        for piece, (first, last) in zip(pieces, itertools.pairwise(edges), strict=True):
            self._rows(known, block, slice(first, last), piece)

    def _rows(self, known: Definitions, block: Block, rows: slice, piece: ChunkPiece | None) -> None:
        """Messages that lie behind one another: their chunk as it is, else a new one of those that have a channel."""
        channel, logged, offsets = block.channel[rows], block.logged[rows].view("<u8"), block.offsets[rows]
        present = np.unique(channel).tolist()
        if piece is not None and all(i in known.channels and known.schema_of(i) is not None for i in present):
            self.old.seek(piece.place)
            packed, offsets = PackedChunk.of(self.old.read(piece.length)), offsets - piece.begin
        else:
            wanted = np.isin(channel, [identity for identity in present if identity in self.log])
            channel, logged, offsets = channel[wanted], logged[wanted], offsets[wanted]
            data, offsets = _gathered(block.buffer, offsets, block.lengths[rows][wanted] + records.HEAD)
            packed = compress_chunk(data)
        if len(offsets):
            self.log.chunk(packed, channel, logged, offsets)
            self.messages += len(offsets)

    def extras(self, known: Definitions) -> None:
        """Write the whole attachments and metadata read so far, and before the first message those next to the log."""
        names = {self._extra(opcode, content) for opcode, content in known.take_extras()}
        for name, text in self.beside.items():
            if not self.messages and name not in names and name not in self.taken:
                self.log.attachment(Attachment(0, 0, name, "application/toml", text.encode()))
                self.taken.append(name)

    def _extra(self, opcode: int, content: bytes) -> str | None:
        """Write an attachment or metadata; its name, None where it is not whole."""
        try:
            if opcode == records.METADATA:
                name, entries = read_metadata(content)
                self.log.metadata(name, entries)
                return None
            attachment = read_attachment(content)
        except records.Damage:
            return None  # it says nothing of the messages, and is not worth losing them for
        self.log.attachment(attachment)
        return attachment.name


def _gathered(buffer: Bytes, offsets: Stamps, lengths: Stamps) -> tuple[bytes, Stamps]:
    """Records behind one another, and where each of them begins then; those that are so already are taken together."""
    ends = offsets + lengths
    breaks = np.flatnonzero(offsets[1:] != ends[:-1]) + 1
    runs = zip([0, *breaks.tolist()], [*breaks.tolist(), len(offsets)], strict=True)
    data = b"".join(buffer[offsets[a] : ends[b - 1]].tobytes() for a, b in runs if b > a)
    return data, np.cumsum(lengths) - lengths


def count_messages(path: Path) -> tuple[int, float]:
    """Messages of a damaged log that are whole, and the time [s] over which they go."""
    log = McapFile(path, accept_cut=True)
    count, first, last = 0, [], []
    for _, messages in log.blocks(set(log.topics)):
        count += len(messages)
        first.append(int(messages.logged.min()))
        last.append(int(messages.logged.max()))
    return count, (max(last) - min(first)) / 1e9 if first else 0.0
