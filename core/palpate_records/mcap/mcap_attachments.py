"""What palpate writes at the head of an MCAP log besides messages: the pipeline's texts, and facts of the run."""

from __future__ import annotations

from pathlib import Path

from palpate import LogError

from palpate_records.recording import LogAttachments

_LARGEST = 1 << 22  # [bytes] of one text
_RECORDS = 10_000  # that are looked at before the first messages


def attached_to(path: Path) -> LogAttachments:
    """Texts and facts that stand before the first message; what a damaged head leaves of them. Raises LogError."""
    import struct

    from mcap.exceptions import McapError
    from mcap.records import Attachment, Chunk, DataEnd, Message, Metadata
    from mcap.stream_reader import StreamReader

    documents: dict[str, str] = {}
    facts: dict[str, str] = {}
    try:
        with path.open("rb") as file:
            reader = StreamReader(file, emit_chunks=True, record_size_limit=1 << 30)
            for _, record in zip(range(_RECORDS), reader.records, strict=False):
                if isinstance(record, Chunk | Message | DataEnd):
                    break
                if isinstance(record, Attachment) and len(record.data) <= _LARGEST:
                    documents[record.name] = record.data.decode("utf-8")
                if isinstance(record, Metadata) and record.name == "palpate":
                    facts |= record.metadata
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error
    except (McapError, struct.error, UnicodeDecodeError, ValueError, MemoryError):
        pass  # the log's own reader says what is damaged
    return LogAttachments(documents, facts)
