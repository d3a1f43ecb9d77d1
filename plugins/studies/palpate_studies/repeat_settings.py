"""The ``[repeat]`` table: the number of palpations, with the pause and the step between them."""

from __future__ import annotations

from typing import ClassVar

from palpate import Length, Settings, Time
from pydantic import Field


class RepeatSettings(Settings):
    """The ``[repeat]`` table: `palpate repeat FILE` makes the palpation so many times, each with its run folder."""

    many_runs_by: ClassVar[str] = "repeat"  # the command that makes them

    count: int = Field(ge=2, le=10_000, description="how often")
    wait: Time = Field(
        default=0.0, ge=0, description="from the end of one to the begin of the next; a fast simulation does not wait"
    )
    step: tuple[Length, Length] = Field(default=(0.0, 0.0), description="how far each goes on from the last one [x, y]")
