"""The motion that is stopped: strokes down and up at constant speed, within the limits of a pipeline."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

from palpate import ConfigurationError, Trajectory
from palpate_engine import Pipeline, SafetySettings, check_motion, own_motions

from palpate_commands.acceptance.steps import Visit

# Choices.
_RETREAT = 2e-3  # [m] between the strokes and the top of the box, for the retreat that checks whether the tip is free
_AIR_HEIGHT = 3e-3  # [m] above the nominal skin, from which on there is free air
_MIN_STROKE, _MAX_STROKE = 6e-3, 15e-3  # [m] between top and bottom
_LIMIT_SHARE = 0.9  # of a limit of speed: rounding of the strokes stays below it
_STRAIGHT_SHARE = 0.8  # of a stroke that is at constant speed; its turns take the rest
_UNATTENDED_MARGIN = 0.25  # [s] of a stroke beyond the longest time in which an arm may go on unattended
_MIN_STROKE_TIME, _MIN_DOWN_TIME = 0.8, 1.5  # [s] that a person needs to hit a stroke, and the way down of one
_ACCELERATION_RATIO = 4.0  # of the limit to the mean acceleration of a turn, speed over time; its profile needs 1.9
_DURATION_BY_HAND = 60.0  # [s] of strokes where a person stops them
_DURATION = 15.0  # [s] otherwise
_DELAY_CYCLES, _SLOW_SHARE = 2, 0.25  # strokes at each of two speeds that show a delay; the slower one, of the faster
_STROKES_PART = "load-unload"  # trajectory that makes them


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
        """Speeds [m/s], one after the other."""
        return (self.speed,) if self.slow is None else (self.slow, self.speed)

    @property
    def lasts(self) -> float:
        """Time [s] that all of them take, but for their turns."""
        return self.duration * sum(self.speed / speed for speed in self.speeds)

    def table(self) -> dict[str, float | None]:
        """Return the strokes in SI."""
        return asdict(self)


def plan_strokes(pipeline: Pipeline, visit: Visit, allowed: float) -> Strokes:
    """Return the longest and fastest strokes that a pipeline's limits and its own motion allow.

    `allowed` [s] is how long the arm may go on. Raises ConfigurationError where the box has no room.
    """
    limits = demand_limits(pipeline)

    # Heights within the box; on foam as deep as the pipeline's own motion, and no faster into it.
    box_top, box_bottom = limits.high[2] - _RETREAT, limits.low[2]
    speed = _LIMIT_SHARE * min(limits.speed, limits.fastest)
    if visit.site == "foam":
        motions = [check_motion(trajectory, limits) for trajectory in pipeline.trajectories.values()]
        bottom = max(float(motions[0].low[2]), box_bottom)
        top = min(box_top, -bottom + _AIR_HEIGHT)  # as far above the skin, z = 0, as the bottom is below, and more
        speed = min(speed, motions[0].inward_speed)
    else:
        top, bottom = box_top, max(box_top - _MAX_STROKE, box_bottom + _RETREAT, _AIR_HEIGHT)
    way = top - bottom
    if way < _MIN_STROKE:
        place = "over the skin" if visit.site == "free-air" else "from free air to the depth of its own motion"
        raise ConfigurationError(
            f"{pipeline.path}: the strokes of the acceptance need {1e3 * _MIN_STROKE:g} mm {place}, and [safety] low "
            f"and high leave {1e3 * way:.1f} mm: raise [safety] high"
        )

    # A stroke lasts for as long as the arm may go on, and until a person can have hit it.
    time_for_hand = _MIN_DOWN_TIME if visit.step.leaves else _MIN_STROKE_TIME
    min_time = max(time_for_hand if visit.step.by_hand else 0.0, allowed + _UNATTENDED_MARGIN)
    speed = min(speed, _STRAIGHT_SHARE * way / min_time)
    turn = _ACCELERATION_RATIO * speed / limits.acceleration
    if not visit.step.stops:
        # Down and up again is one cycle.
        return Strokes(top, bottom, speed, turn, _DELAY_CYCLES * 2.0 * way / speed, _SLOW_SHARE * speed)
    return Strokes(top, bottom, speed, turn, _DURATION_BY_HAND if visit.step.by_hand else _DURATION)


def demand_limits(pipeline: Pipeline) -> SafetySettings:
    """Return the limits of a pipeline; raises ConfigurationError where it has no limits, no motion or no arm."""
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
    """Return a pipeline that makes strokes, has no sinks and no tracks; raises ConfigurationError.

    `stop_force` [N], if any, is lower than that of the pipeline.
    """
    entry = pipeline.registry.parts["trajectory"].get(_STROKES_PART)
    if entry is None or entry.problem is not None:
        raise ConfigurationError(
            f"the strokes of the acceptance are the motion {_STROKES_PART!r}, whose plugin is not installed"
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
