"""One run of strokes: its settings, and its folder, which holds all that it leaves behind."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats
from palpate_engine import RESULT

from palpate_commands.acceptance.strokes import Strokes

MESSAGES, RUN = "messages.txt", "run"
FORCE = "force"  # record of the force, of one column [N]


def row_type(columns: int) -> np.dtype[np.void]:
    """Return the layout of a row of a record: a time-stamp [ns], and the values of a stream."""
    return np.dtype([("time", "<i8"), ("values", "<f8", (columns,))])


@dataclass(frozen=True)
class StrokesRun:
    """A run to make: its folder, which holds all that it writes, and its motion."""

    folder: Path
    strokes: Strokes
    stop_force: float | None  # [N]; None: that of the pipeline

    def record(self, name: str) -> Path:
        """Return the path of a record, of the force or of a stream of the arm."""
        return self.folder / f"{name}.bin"

    @property
    def message(self) -> str:
        """Message of the run at its end."""
        return (self.folder / MESSAGES).read_text(errors="replace").strip()

    @property
    def live_facts(self) -> dict[str, Any]:
        """Facts of the live run in `result.json`; none of one that was killed."""
        try:
            table = json.loads((self.folder / RUN / RESULT).read_text())
        except FileNotFoundError:
            return {}
        facts: dict[str, Any] = table["run"].get("live", {})
        return facts

    def readings(self, origin: int) -> tuple[Floats, Floats]:
        """Return times (n,) [s] from an instant [ns], and the force (n,) [N] as it was read."""
        rows = np.frombuffer(self.record(FORCE).read_bytes(), row_type(1))
        return (rows["time"] - origin) / 1e9, np.asarray(rows["values"][:, 0], np.float64)
