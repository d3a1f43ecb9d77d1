"""Recovery: what is whole of a damaged MCAP log, in a new log that is whole."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from palpate import LogError, OutputError
from palpate.host import progressed

from palpate_devices.logs import mcap_records as records
from palpate_devices.logs.mcap_definitions import Known
from palpate_devices.logs.mcap_file import McapFile
from palpate_devices.logs.mcap_records import Block
from palpate_devices.logs.topics import Topic


def recover_mcap(path: Path, out: Path) -> str:
    """Write the whole part of a log into a new file, and say how much that is; raises LogError, OutputError."""
    from mcap.writer import Writer

    log = McapFile(path, accept_cut=True)
    try:
        with out.open("xb") as file:
            writer = Writer(file)
            writer.start(profile="ros2", library="palpate recover")
            saved = _Saved(writer)
            known = Known(extras=[])
            for known, block in log.everything():
                saved.block(known, block)
                progressed(saved.messages)
            for opcode, content in known.extras or ():
                saved.extra(opcode, content)
            writer.finish()  # type: ignore[no-untyped-call]
    except FileExistsError as error:
        raise OutputError(f"{out}: is there already, and nothing is ever overwritten") from error
    except OSError as error:
        raise OutputError(f"{out}: cannot write: {error.strerror}") from error
    if not saved.messages:
        out.unlink()
        raise LogError(f"{path}: nothing in it is whole")
    said = f"{saved.messages} messages over {(saved.last - saved.first) / 1e9:.3f} s are in {out}"
    if log.complete:
        return f"the log was whole: {said}"
    return f"{said}; {log.report.words() if log.report else 'its end was missing'}"


@dataclass
class _Saved:
    """The new log."""

    writer: Any
    messages: int = 0
    first: int = 0
    last: int = 0
    channels: dict[int, int] = field(default_factory=dict)
    schemas: dict[tuple[str, str, bytes], int] = field(default_factory=dict)

    def block(self, known: Known, block: Block) -> None:
        """Write the messages of a block whose channel is known."""
        data = block.buffer.tobytes()
        for offset in block.offsets.tolist():
            channel, sequence, logged, published = struct.unpack_from("<HIQQ", data, offset + 9)
            topic = known.channels.get(channel)
            if topic is None:
                continue
            if channel not in self.channels:
                self.channels[channel] = self._channel(topic)
            end = offset + 9 + struct.unpack_from("<Q", data, offset + 1)[0]
            payload = data[offset + records.HEAD : end]
            self.writer.add_message(self.channels[channel], logged, payload, published, sequence)
            self.first = logged if not self.messages else min(self.first, logged)
            self.last = max(self.last, logged)
            self.messages += 1

    def _channel(self, topic: Topic) -> int:
        key = (topic.type, topic.schema_encoding, topic.schema)
        if key not in self.schemas:
            self.schemas[key] = self.writer.register_schema(*key) if topic.type or topic.schema else 0
        return int(self.writer.register_channel(topic.name, topic.encoding, self.schemas[key], dict(topic.metadata)))

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
                self.writer.add_metadata(name, entries)
            else:
                logged, created = struct.unpack_from("<QQ", content)
                name, at = records.read_text(content, 16)
                kind, at = records.read_text(content, at)
                (length,) = struct.unpack_from("<Q", content, at)
                self.writer.add_attachment(created, logged, name, kind, content[at + 8 : at + 8 + length])
        except (records.Damage, struct.error):
            return  # it says nothing of the messages, and is not worth losing them for


def counted(path: Path) -> tuple[int, float]:
    """Messages of a damaged log that are whole, and the time [s] over which they go."""
    log = McapFile(path, accept_cut=True)
    count, first, last = 0, [], []
    for _, messages in log.blocks(set(log.topics)):
        count += len(messages)
        first.append(int(messages.logged.min()))
        last.append(int(messages.logged.max()))
    return count, (max(last) - min(first)) / 1e9 if first else 0.0
