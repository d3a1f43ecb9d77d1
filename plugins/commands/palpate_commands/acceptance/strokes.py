"""The motion that is stopped: strokes down and up at constant speed, within the limits of a pipeline."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

from palpate import ConfigurationError, Trajectory
from palpate_engine import Pipeline, SafetySettings, check_motion, own_motions

from palpate_commands.acceptance.steps import Visit

_ROOM = 2e-3  # [m] between the strokes and the top of the box, for the retreat that checks whether the tip is free
_AIR = 3e-3  # [m] over the nominal skin that free air begins
_LEAST, _MOST = 6e-3, 15e-3  # [m] of a stroke
_SPARE = 0.9  # of a limit
_BLIND_SPARE = 0.25  # [s] of a stroke beyond the longest time in which an arm may go on unattended
_AT_ANY_TIME, _ON_THE_WAY_DOWN = 0.8, 1.5  # [s] that a stroke takes at least where a person is to hit it
_SOFT = 4.0  # times its own mean acceleration that a turn may take at most; its profile needs 1.9
_PATIENCE = 60.0  # [s] of strokes where a person stops them
_FEW = 15.0  # [s] otherwise
_CYCLES, _SLOW = 2, 0.25  # strokes at each of two speeds, the slower a part of the faster
_KIND = "load-unload"


@dataclass(frozen=True)
class Strokes:
    """Strokes between two heights in the work frame."""

    top: float  # [m]
    bottom: float  # [m]
    speed: float  # [m/s]
    turn: float  # [s] of each turn
    duration: float  # [s] of all of them at that speed
    slow: float | None = None  # [m/s] of as many before them

    @property
    def straight(self) -> tuple[float, float]:
        """Highest and lowest height [m] between which the speed is constant on the way down."""
        bend = self.speed * self.turn / 2
        return self.top - bend, self.bottom + bend

    @property
    def speeds(self) -> tuple[float, ...]:
        """[m/s] one after the other."""
        return (self.speed,) if self.slow is None else (self.slow, self.speed)

    @property
    def lasts(self) -> float:
        """Time [s] that all of them take, but for their turns."""
        return self.duration * sum(self.speed / speed for speed in self.speeds)

    def table(self) -> dict[str, float | None]:
        """In SI."""
        return asdict(self)


def plan_strokes(pipeline: Pipeline, visit: Visit, allowed: float) -> Strokes:
    """The longest and fastest strokes that a pipeline's limits and its own motion allow.

    `allowed` [s] is how long the arm may go on. Raises ConfigurationError where the box has no room.
    """
    limits = demand_limits(pipeline)
    box_top, box_bottom = limits.high[2] - _ROOM, limits.low[2]
    speed = _SPARE * min(limits.speed, limits.fastest)
    if visit.site == "foam":
        motion = [check_motion(trajectory, limits) for trajectory in pipeline.trajectories.values()]
        bottom = max(float(motion[0].low[2]), box_bottom)
        top, speed = min(box_top, -bottom + _AIR), min(speed, motion[0].inward_speed)
    else:
        top, bottom = box_top, max(box_top - _MOST, box_bottom + _ROOM, _AIR)
    way = top - bottom
    if way < _LEAST:
        where = "over the skin" if visit.site == "free-air" else "from free air to the depth of its own motion"
        raise ConfigurationError(
            f"{pipeline.path}: the strokes of the acceptance need {1e3 * _LEAST:g} mm {where}, and [safety] low "
            f"and high leave {1e3 * way:.1f} mm: raise [safety] high"
        )
    slow = _ON_THE_WAY_DOWN if visit.step.leaves else _AT_ANY_TIME
    least = max(slow if visit.step.by_hand else 0.0, allowed + _BLIND_SPARE)
    speed = min(speed, 0.8 * way / least)
    turn = _SOFT * speed / limits.acceleration
    if not visit.step.stops:
        return Strokes(top, bottom, speed, turn, _CYCLES * 2.0 * way / speed, _SLOW * speed)
    return Strokes(top, bottom, speed, turn, _PATIENCE if visit.step.by_hand else _FEW)


def demand_limits(pipeline: Pipeline) -> SafetySettings:
    """Raise ConfigurationError where a pipeline has no limits, no motion or no arm."""
    if pipeline.safety is None:
        raise ConfigurationError(f"{pipeline.path}: nothing moves without limits: a [safety] table is missing")
    if len(pipeline.trajectories) != 1:
        raise ConfigurationError(
            f"{pipeline.path}: expected one [trajectory.*] table, not {len(pipeline.trajectories)}: the depth on foam "
            "is that of the rig's own motion"
        )
    if not own_motions(pipeline.devices):
        raise ConfigurationError(f"{pipeline.path}: no device is a robot: there is nothing to accept")
    return pipeline.safety


def strokes_pipeline(pipeline: Pipeline, strokes: Strokes, stop_force: float | None = None) -> Pipeline:
    """A pipeline that makes strokes, records nothing by itself and estimates nothing; raises ConfigurationError.

    `stop_force` [N], where it is given, is lower than that of the pipeline.
    """
    entry = pipeline.registry.parts["trajectory"].get(_KIND)
    if entry is None or entry.problem is not None:
        raise ConfigurationError(
            f"the strokes of the acceptance are the motion {_KIND!r}, whose plugin is not installed"
        )
    limits = demand_limits(pipeline)
    middle = (strokes.top + strokes.bottom) / 2
    settings: dict[str, Any] = {
        "depth": middle - strokes.bottom,
        "clearance": strokes.top - middle,
        "surface": {"height": middle},
        "speeds": list(strokes.speeds),
        "cycles": max(1, round(strokes.duration * strokes.speed / (2 * (strokes.top - strokes.bottom)))),
        "turn": strokes.turn,
        "standstill": 0.0,
        "place": [(low + high) / 2 for low, high in zip(limits.low[:2], limits.high[:2], strict=True)],
    }
    trajectory = entry.part.model_validate(settings)
    assert isinstance(trajectory, Trajectory)
    if stop_force is not None:
        limits = limits.model_copy(update={"stop_force": stop_force})
    if problems := check_motion(trajectory, limits).problems:
        raise ConfigurationError(f"{pipeline.path}: the strokes of the acceptance break a limit: {'; '.join(problems)}")
    return replace(pipeline, trajectories={"strokes": trajectory}, tracks=(), sinks={}, safety=limits, tables={})
