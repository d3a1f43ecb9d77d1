"""The ``[bench]`` table: the measure by which the tracks of a pipeline are compared."""

from __future__ import annotations

from typing import Literal

from palpate import Settings
from pydantic import Field


class MeasureSettings(Settings):
    """Settings of `palpate bench`: the measure of the tracks of a pipeline; records are those of ``[sweep]``."""

    measure: Literal["values", "prediction"] = Field(
        default="values",
        description='"values": errors of the values where a truth is known; "prediction": of the force alone, as of a '
        "material that no model of the pipeline knows",
    )
