"""The ``[sweep]`` table: lists of values by setting."""

from __future__ import annotations

from typing import ClassVar, Literal

from palpate import Settings
from pydantic import ConfigDict, Field


class SweepSettings(Settings):
    """Lists of values by setting, such as ``"estimator.afukf.fading.theta" = ["1 mm/s"]``, for `palpate sweep`."""

    model_config = ConfigDict(extra="allow")
    many_runs_by: ClassVar[str] = "sweep"  # the command that makes them

    combine: Literal["grid", "list"] = Field(
        default="grid", description='"grid": every value with every other; "list": the first of each, the second, ...'
    )
