"""Recovery: the undamaged part of an MCAP log, in a new complete log."""

from __future__ import annotations

import itertools
import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np
from palpate import LogError, OutputError

from palpate_records.mcap import mcap_records as records
from palpate_records.mcap.mcap_copy import NewLog, PackedChunk, compress_chunk
from palpate_records.mcap.mcap_definitions import Definitions
from palpate_records.mcap.mcap_file import McapFile
from palpate_records.mcap.mcap_records import Block, ChunkPiece
from palpate_records.messages.topics import Bytes, Stamps
from palpate_records.progress import Progress, silent
from palpate_records.temporary_folders import scratch

_NEW = "new.mcap"


def recover_mcap(path: Path, out: Path, progress: Progress = silent) -> str:
    """Write the undamaged part of a log into a new file, and report how much that is; raises LogError, OutputError."""
    if out.exists():
        raise OutputError(f"{out}: exists already, and nothing is ever overwritten")
    log = McapFile(path, accept_cut=True)
    try:
        with scratch(out.parent) as folder:
            saved = _written(log, folder, progress)
            if not saved.messages:
                raise LogError(f"{path}: nothing in it is undamaged")
            if out.exists():
                raise OutputError(f"{out}: exists by now, and nothing is ever overwritten")
            (folder / _NEW).rename(out)
    except OSError as error:
        raise OutputError(f"{out}: cannot write: {error.strerror}") from error
    first, last = saved.log.span
    said = f"{saved.messages} messages over {(last - first) / 1e9:.3f} s are in {out}"
    if log.complete:
        return f"the log was whole: {said}"
    return f"{said}; {log.report.words() if log.report else 'its end was missing'}"


def _written(log: McapFile, folder: Path, progress: Progress) -> _RecoveredLog:
    """The new log, in a folder."""
    with log.path.open("rb") as old, (folder / _NEW).open("xb") as file, (folder / "index").open("x+b") as index:
        saved = _RecoveredLog(NewLog(file, index), old)
        known = Definitions(extras=[])
        for known, block in log.everything():
            saved.block(known, block)
            progress(saved.messages)
        for opcode, content in known.extras or ():
            saved.extra(opcode, content)
        saved.log.finish()
        file.flush()
        os.fsync(file.fileno())
    return saved


@dataclass
class _RecoveredLog:
    """The new log, and the old one."""

    log: NewLog
    old: IO[bytes]
    messages: int = 0

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

    def extra(self, opcode: int, content: bytes) -> None:
        """Write an attachment or metadata, where they are whole."""
        try:
            if opcode == records.METADATA:
                name, at = records.read_text(content, 0)
                packed, _ = records.read_bytes(content, at)
                entries, at = {}, 0
                while at < len(packed):
                    key, at = records.read_text(packed, at)
                    entries[key], at = records.read_text(packed, at)
                self.log.metadata(name, entries)
            else:
                logged, created = struct.unpack_from("<QQ", content)
                name, at = records.read_text(content, 16)
                kind, at = records.read_text(content, at)
                (length,) = struct.unpack_from("<Q", content, at)
                self.log.attachment(created, logged, name, kind, content[at + 8 : at + 8 + length])
        except (records.Damage, struct.error):
            return  # it says nothing of the messages, and is not worth losing them for


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
