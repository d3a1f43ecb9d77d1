"""One run of strokes: what it is to do, and its folder, which holds all that it leaves behind."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats
from palpate_engine import RESULT

from palpate_commands.acceptance.strokes import Strokes

READING = np.dtype([("time", "<i8"), ("force", "<f8")])  # [ns], [N]
READINGS, MESSAGES, RUN = "force.bin", "messages.txt", "run"


@dataclass(frozen=True)
class StrokesRun:
    """A run to make: its folder, which holds all that it says, and what it is to do."""

    folder: Path
    strokes: Strokes
    stop_force: float | None  # [N]; None: that of the pipeline

    @property
    def message(self) -> str:
        """What it said at its end."""
        return (self.folder / MESSAGES).read_text(errors="replace").strip()

    @property
    def live_facts(self) -> dict[str, Any]:
        """What `result.json` says of the live run; nothing of one that was killed."""
        try:
            table = json.loads((self.folder / RUN / RESULT).read_text())
        except FileNotFoundError:
            return {}
        found: dict[str, Any] = table["run"].get("live", {})
        return found

    def readings(self, origin: int) -> tuple[Floats, Floats]:
        """Times (n,) [s] from an instant [ns], and the force (n,) [N] as it was read."""
        rows = np.frombuffer((self.folder / READINGS).read_bytes(), READING)
        return (rows["time"] - origin) / 1e9, np.asarray(rows["force"], np.float64)
