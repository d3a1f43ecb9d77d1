"""A curve: a file, or readings of one."""

from __future__ import annotations

from dataclasses import dataclass

from palpate import Batch


@dataclass(frozen=True)
class Curve:
    """One curve: a file, or its readings."""

    name: str
    file: str = ""
    batches: tuple[Batch, ...] = ()
    own: tuple[str, ...] = ()  # settings of this curve alone, as of ``--set``
