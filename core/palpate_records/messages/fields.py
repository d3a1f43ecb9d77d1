"""One field of a message type, whatever language defines it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Field:
    """One field of a message type."""

    name: str
    type: str  # a primitive, "string", or the full name of another type
    count: int | None = 1  # elements; None if each message states their number
    many: bool = False  # True for an array or a sequence
