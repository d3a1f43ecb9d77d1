"""What palpate writes at the head of an MCAP log besides messages: the pipeline's texts, and facts of the run."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from palpate_records.mcap import mcap_records as records
from palpate_records.mcap.mcap_extras import head_extras, read_attachment, read_metadata
from palpate_records.recording import LogAttachments


def attached_to(path: Path) -> LogAttachments:
    """Texts and facts that stand before the first message; what a damaged head leaves of them. Raises LogError."""
    documents: dict[str, str] = {}
    facts: dict[str, str] = {}
    for opcode, content in head_extras(path):
        with suppress(records.Damage, UnicodeDecodeError):  # the log's own reader says what is damaged
            if opcode == records.ATTACHMENT:
                attachment = read_attachment(content)
                documents[attachment.name] = attachment.content.decode("utf-8")
            else:
                name, entries = read_metadata(content)
                facts |= entries if name == "palpate" else {}
    return LogAttachments(documents, facts)
