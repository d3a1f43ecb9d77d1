"""The motions of a search: points and short lines with the press of a run, and how long they take."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from palpate import ConfigurationError, Floats, Surface, Trajectory, duration_of, surface_of
from palpate_engine import Pipeline

from palpate_maps.next_places import Proposal

# Choices: between these distances and lengths the planned times are taken for linear.
_DISTANCES = np.array([0.0, 1e-3, 5e-3, 20e-3, 60e-3, 200e-3])  # [m] at which the travel between points is planned
_LONGER = 0.02  # [m] by which the longer of two planned lines is longer
_MIN_PERIODS = 4.0  # of the sine along a line
_SITE_WIDTH = 4e-3  # [m] that a line has besides
_PACES = ("travel_speed", "turn_speed")  # of the run's own travel above a surface, which its limits allow


@dataclass(frozen=True)
class SearchMotion:
    """The palpation of places by the rig of a run, and of lines where the run's own motion goes along lines."""

    pipeline: Pipeline
    name: str  # of the run's motion
    duration: float  # [s] of sine at each place

    @property
    def own(self) -> Any:
        """The motion of the run."""
        return self.pipeline.trajectories[self.name]

    @property
    def line_speed(self) -> float | None:
        """Speed along lines [m/s], that of the run, which its estimators are set for; None where it has none."""
        return getattr(self.own, "speed", None)

    @property
    def shortest(self) -> float:
        """Length of the shortest line [m]: four periods of the sine, and a site more."""
        return _SITE_WIDTH + _MIN_PERIODS * (self.line_speed or 0.0) / float(self.own.press.frequency)

    def along(self, proposals: list[Proposal], level: bool = False) -> Trajectory:
        """Return the motion through places, or along one line; raises ConfigurationError.

        It has the press of the run's own motion, and its surface unless it is to be `level`.
        """
        own, first = self.own, proposals[0]
        settings: dict[str, Any] = {"press": own.press}
        if not level:
            settings["surface"] = own.surface
        if first.end is None:
            part: Any = self.pipeline.registry.find("trajectory", "grid-points")
            settings |= {"places": tuple(proposal.place for proposal in proposals), "duration": self.duration}
            if self.surface is not None:
                settings |= {key: getattr(own, key) for key in _PACES if hasattr(own, key)}
        else:
            part = self.pipeline.registry.find("trajectory", "line-sweep")
            settings |= {"start": first.place, "end": first.end, "speed": self.line_speed, "settle": own.settle}
        try:
            return part(**settings)  # type: ignore[no-any-return]
        except ValueError as error:
            raise ConfigurationError(f"the places cannot be visited: {error}") from error

    @property
    def surface(self) -> Surface | None:
        """That the motion of the run follows; None where it follows a nominal height."""
        return surface_of(self.own)

    def can_go(self, proposals: list[Proposal]) -> bool:
        """Return True if a surface is known all the way from each place to the next."""
        try:
            duration_of(self.along(proposals))
        except ConfigurationError:
            return False
        return True

    def _seconds(self, proposals: list[Proposal]) -> float:
        """Return the duration [s] of a motion that may be anywhere: over a surface, as over a plane."""
        return float(duration_of(self.along(proposals, level=self.surface is not None)))

    def seconds_to(self, distance: Floats) -> Floats:
        """Return the seconds that a further point takes, by its distance [m] from the one before."""
        return np.interp(distance, _DISTANCES, self._steps)

    @cached_property
    def way_of_turn(self) -> float:
        """Travel of the tip while the tool turns by a radian [m/rad]."""
        visit: Any = self.along([_at(0.0)], level=True)
        return float(visit.travel_speed / visit.turn_speed)

    @cached_property
    def _steps(self) -> Floats:
        """Seconds (6,) that a second point takes more than the first alone, at each of the distances."""
        pairs = [self._seconds([_at(0.0), _at(float(way))]) for way in _DISTANCES]
        return np.array(pairs) - self.first_point

    @cached_property
    def first_point(self) -> float:
        """Seconds that one point takes, from rest to rest."""
        return self._seconds([_at(0.0)])

    @cached_property
    def _line(self) -> tuple[float, float]:
        """Seconds of a line without length, and seconds for each metre more, by two planned lines."""
        lengths = (self.shortest, self.shortest + _LONGER)
        short, long = (
            self._seconds([Proposal(place=(0.0, 0.0), contrast=0.0, std=0.0, suspicion=0.0, end=(length, 0.0))])
            for length in lengths
        )
        slope = (long - short) / _LONGER
        return short - slope * lengths[0], slope

    def seconds_along(self, way: Floats) -> Floats:
        """Return the seconds that a line takes, by its length [m]."""
        start, slope = self._line
        return start + slope * way


def _at(x: float) -> Proposal:
    return Proposal((x, 0.0), 0.0, 0.0, 0.0)


def search_motion(pipeline: Pipeline, run: Any, duration: float) -> SearchMotion:
    """Return the motion of a run, with a press to palpate points with; raises ConfigurationError."""
    if len(pipeline.trajectories) != 1:
        raise ConfigurationError(f"{run}: moves nothing, so it cannot visit places")
    ((name, motion),) = pipeline.trajectories.items()
    if not hasattr(motion, "press") or not hasattr(motion, "surface"):
        raise ConfigurationError(f"{run}: [trajectory.{name}] has no press = {{...}} to palpate points with")
    return SearchMotion(pipeline, name, duration)
