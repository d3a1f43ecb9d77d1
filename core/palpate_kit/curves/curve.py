"""A curve: a file, or readings of one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate import Batch, Device


@dataclass(frozen=True)
class Curve:
    """One curve: a file, or its readings."""

    name: str
    file: str = ""
    batches: tuple[Batch, ...] = ()
    own: tuple[str, ...] = ()  # settings of this curve alone, as of ``--set``
    record: str | None = None  # of a file of several
    place: tuple[float, float] | None = None  # x and y [m], as its file or ``curves.csv`` states them

    def read_by(self, device: Device) -> Device:
        """Return the device with the file of the curve, and its record."""
        update: dict[str, Any] = {"file": Path(self.file)}
        if "record" in type(device).model_fields:
            update["record"] = self.record
        return device.model_copy(update=update)
