"""What speaks against the calibration that a pipeline names, as flags of its result."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from palpate.calibration import identity_in
from palpate.config import Pipeline, plain_settings
from palpate.flags import Flag


def calibration_flags(pipeline: Pipeline, live: Mapping[str, Mapping[str, Any]] | None = None) -> tuple[Flag, ...]:
    """Flags of an old calibration, of another sensor or tip, and of settings that contradict it.

    `live` is what connected devices said of themselves, by name.
    """
    if pipeline.calibration is None or pipeline.stated is None:
        return ()

    def table(part: object) -> object:
        return plain_settings(part, pipeline.registry)

    present = {
        name: {**device.provenance, **identity_in((live or {}).get(name, {}))}
        for name, device in pipeline.devices.items()
    }
    return tuple(pipeline.calibration.flags(pipeline.stated, present, pipeline.indenters, table, datetime.now(UTC)))
