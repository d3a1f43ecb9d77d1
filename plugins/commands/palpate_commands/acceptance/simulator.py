"""The simulator in the place of a rig's arm, and the steps of an acceptance that it lacks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from palpate_engine import Pipeline

from palpate_commands.acceptance.steps import Visit
from palpate_commands.acceptance.watched_arm import WatchedArm


@dataclass(frozen=True)
class Simulator:
    """A twin of the pipeline, served in the place of the arm."""

    name: str
    absent_stops: Sequence[str]  # fields of `StopModes`

    @classmethod
    def of(cls, pipeline: Pipeline) -> Simulator | None:
        """Return the twin to which the arm's settings lead; None of a rig, and of a rehearsal."""
        arm = WatchedArm.of(pipeline).device
        for name, twin in pipeline.twins.items() if pipeline.run.rehearsal is None else ():
            if twin.replaces(arm):
                return cls(name, twin.absent_stops)
        return None

    def lacks(self, visit: Visit) -> bool:
        """Return True for a stop that it does not have."""
        return visit.step.mode in self.absent_stops
