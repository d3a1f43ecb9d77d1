"""What speaks against the calibration that a pipeline names, as flags of its result."""

from __future__ import annotations

from datetime import UTC, datetime

from palpate.config import Pipeline, plain_settings
from palpate.result import flag


def calibration_flags(pipeline: Pipeline) -> tuple[str, ...]:
    """Flags of an old calibration, of another sensor or tip, and of settings that contradict it."""
    if pipeline.calibration is None or pipeline.stated is None:
        return ()

    def table(part: object) -> object:
        return plain_settings(part, pipeline.registry)

    found = pipeline.calibration.flags(pipeline.stated, pipeline.devices, pipeline.indenters, table, datetime.now(UTC))
    return tuple(flag(code, text) for code, text in found)
