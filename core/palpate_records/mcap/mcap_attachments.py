"""The texts of the pipeline and the facts of the run that palpate writes at the head of an MCAP log."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from palpate_records.mcap import mcap_records as records
from palpate_records.mcap.mcap_extras import head_extras, read_attachment, read_metadata
from palpate_records.recording import LogAttachments


def attached_to(path: Path) -> LogAttachments:
    """Return the texts and facts before the first message, without damaged ones; raises LogError."""
    documents: dict[str, str] = {}
    facts: dict[str, str] = {}
    for opcode, content in head_extras(path):
        with suppress(records.Damage, UnicodeDecodeError):  # the reader of the messages reports damage
            if opcode == records.ATTACHMENT:
                attachment = read_attachment(content)
                documents[attachment.name] = attachment.content.decode("utf-8")
            else:
                name, entries = read_metadata(content)
                facts |= entries if name == "palpate" else {}
    return LogAttachments(documents, facts)
