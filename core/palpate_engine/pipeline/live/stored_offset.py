"""The sensor's reading in free air as the file knows it: stated, or by a calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from palpate_engine.config import Pipeline
from palpate_engine.pipeline.rig import Rig


@dataclass(frozen=True)
class Offset:
    """The sensor's reading in free air [N], sign included, as stated or by a calibration, and why it may not hold."""

    value: float
    doubt: str | None = None

    def table(self) -> dict[str, Any]:
        """As in ``result.json``."""
        return {"value": self.value, "counts": self.doubt is None, "doubt": self.doubt}


def stored_offset(rig: Rig, live: Mapping[str, Mapping[str, Any]]) -> Offset | None:
    """Return the offset that the file knows, if any; `live` is what connected devices say of themselves."""
    tare = rig.alignment.tare
    if not isinstance(tare, float):
        return None
    if (
        not isinstance(rig, Pipeline)
        or rig.calibration is None
        or rig.stated is None
        or rig.stated.tare != "calibrated"
    ):
        return Offset(tare)
    flag = rig.calibration.offset_doubt(rig, live)
    return Offset(tare, None if flag is None else flag.message)
