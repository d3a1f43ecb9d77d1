"""What remains of a run after an interruption."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from palpate import ConfigurationError, Floats, Resumable, Trajectory, duration_of
from palpate_engine import Pipeline, is_live
from palpate_kit.runs.continuation import continue_pipeline, recorded_pipeline
from palpate_kit.runs.run_folder import RunFolder

_CAUTION = 0.5  # [s]; what ended this much before the record did is taken for finished
_STEP = 0.05  # [s] of the search for the motion's begin in a record
_FOLLOWED = 1e-3  # [m] that a tip may be from where the motion has it
_ROWS = 2000  # of the record that are compared for it


def remaining_pipeline(folder: Path, overrides: Sequence[str] = ()) -> Pipeline | None:
    """The pipeline that does what a run and its continuations left undone, or None where all was finished.

    Every part may have left something; a later part whose motion is just that has done it. The pipeline is that of the
    part, with overrides on top. Raises ConfigurationError where a motion can only be done as one, or is overridden.
    """
    for assignment in overrides:
        if assignment.startswith("trajectory."):
            raise ConfigurationError(f"--set {assignment}: what is left of a motion is as recorded; run another one")
    run = RunFolder(folder)
    recorded_pipeline(folder)
    left: list[tuple[Path, Pipeline, Trajectory]] = []
    for part in run.parts:
        if not part.began:
            continue  # ended before it began
        pipeline = recorded_pipeline(part.path)
        if len(pipeline.trajectories) != 1:
            raise ConfigurationError(f"{part.path}: moves nothing, so there is nothing to resume")
        (trajectory,) = pipeline.trajectories.values()
        left = [item for item in left if item[2] != trajectory]
        remaining = _remaining(part, pipeline, trajectory)
        if remaining is not None:
            left.append((part.path, pipeline, remaining))
    if not left:
        return None
    where, pipeline, remaining = left[0]
    if not isinstance(remaining, Resumable):
        (name,) = pipeline.trajectories
        raise ConfigurationError(f"{where}: [trajectory.{name}] cannot be continued, only repeated: run it again")
    return continue_pipeline(recorded_pipeline(where, overrides), remaining, len(run.parts))


def _remaining(part: RunFolder, pipeline: Pipeline, trajectory: Trajectory) -> Trajectory | None:
    """The part of a motion left undone: all of it where it cannot be divided."""
    elapsed = _elapsed(part, pipeline, trajectory)
    if elapsed >= duration_of(trajectory) - _CAUTION:
        return None
    return trajectory.after(elapsed - _CAUTION) if isinstance(trajectory, Resumable) else trajectory


def _elapsed(part: RunFolder, pipeline: Pipeline, trajectory: Trajectory) -> float:
    """How long [s] the motion went on. A live record begins before its motion: with standstill and way to its start.

    The delay is that at which the places that were recorded are those of the motion. Nor is it time of the motion when
    the tip no longer follows it: a retraction after the interruption is recorded, too.
    """
    time, place = part.places
    end = float(time[-1]) if len(time) else 0.0
    if not is_live(pipeline.devices):
        return end
    standstill = pipeline.safety.standstill if pipeline.safety else 0.0
    known = np.isfinite(place).all(axis=1)
    if not known.any():  # of a motion that was cut it is not known how far it came
        return end - standstill if end - standstill >= duration_of(trajectory) else 0.0
    every = max(int(known.sum()) // _ROWS, 1)
    time, place = time[known], place[known]
    delay = _delay(time[::every], place[::every], trajectory, standstill)
    apart = np.linalg.norm(trajectory.at(time - delay).position[:, :2] - place, axis=1)
    followed = time[apart < _FOLLOWED]
    return (float(followed[-1]) if len(followed) else 0.0) - delay


def _delay(time: Floats, place: Floats, trajectory: Trajectory, least: float) -> float:
    """The delay [s] of a motion's begin, at least `least`, that explains recorded places (n, 2) best; the latest of
    equals, so that nothing counts as done that was not."""
    delays = np.arange(least, max(float(time[-1]), least) + _STEP, _STEP)
    apart = [float(((trajectory.at(time - delay).position[:, :2] - place) ** 2).mean()) for delay in delays]
    best = min(apart) + 1e-12  # [m^2]: equal to a micrometre
    return float(delays[np.flatnonzero(np.array(apart) <= best)[-1]])
