"""``palpate run resume``: continue a run that was interrupted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from palpate import ConfigurationError, Floats, Resumable, Trajectory, duration_of
from palpate_engine import Pipeline, is_live
from palpate_kit.runs.continuation import continue_pipeline, demand_unchanged, recorded_pipeline
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.terminal.options import Overrides, UnchangedOption

from palpate_commands.run import execute

# Choices.
_REPEATED_TIME = 0.5  # [s] before the end of a record that is done again: what ended earlier counts as finished
_DELAY_STEP = 0.05  # [s] of the search for the begin of the motion in a record
_MAX_DISTANCE = 1e-3  # [m] of a tip that follows its motion
_MAX_ROWS = 2000  # of the record, that are compared for the begin
_DELAY_TOLERANCE = 1e-12  # [m^2] between mean squares of distances that are equal: a micrometre


def remaining_pipeline(folder: Path, overrides: Sequence[str] = ()) -> Pipeline | None:
    """Return the pipeline that does the rest of a run and its continuations; None where all was finished.

    A part is the run or one of its continuations. Each may have left a rest of its motion; a later part whose motion is
    just that has done it. The pipeline is that of the part, with overrides on top. Raises ConfigurationError where a
    motion can only be done as one, or is overridden.
    """
    for assignment in overrides:
        if assignment.startswith("trajectory."):
            raise ConfigurationError(f"--set {assignment}: what is left of a motion is as recorded; run another one")
    run = RunFolder(folder)
    recorded_pipeline(folder)
    unfinished: list[tuple[Path, Pipeline, Trajectory]] = []
    for part in run.parts:
        if not part.began:
            continue  # ended before it began
        pipeline = recorded_pipeline(part.path)
        if len(pipeline.trajectories) != 1:
            raise ConfigurationError(f"{part.path}: moves nothing, so there is nothing to resume")
        (trajectory,) = pipeline.trajectories.values()
        unfinished = [entry for entry in unfinished if entry[2] != trajectory]
        remaining = _remaining(part, pipeline, trajectory)
        if remaining is not None:
            unfinished.append((part.path, pipeline, remaining))
    if not unfinished:
        return None
    path, pipeline, remaining = unfinished[0]
    if not isinstance(remaining, Resumable):
        (name,) = pipeline.trajectories
        raise ConfigurationError(f"{path}: [trajectory.{name}] cannot be continued, only repeated: run it again")
    return continue_pipeline(recorded_pipeline(path, overrides), remaining, len(run.parts))


def _remaining(part: RunFolder, pipeline: Pipeline, trajectory: Trajectory) -> Trajectory | None:
    """Return the part of a motion that is not done; all of it where it cannot be divided."""
    elapsed = _elapsed(part, pipeline, trajectory)
    if elapsed >= duration_of(trajectory) - _REPEATED_TIME:
        return None
    return trajectory.after(elapsed - _REPEATED_TIME) if isinstance(trajectory, Resumable) else trajectory


def _elapsed(part: RunFolder, pipeline: Pipeline, trajectory: Trajectory) -> float:
    """Return for how long [s] the motion of a part of a run went on, by the places that were recorded.

    A live record begins before its motion, with standstill and way to its start: the delay is that at which the
    recorded places are those of the motion. Where the tip no longer follows it the motion is over: a retraction after
    the interruption is recorded, too.
    """
    time, place = part.places
    end = float(time[-1]) if len(time) else 0.0
    if not is_live(pipeline.devices):
        return end
    standstill = pipeline.safety.standstill if pipeline.safety else 0.0
    is_finite = np.isfinite(place).all(axis=1)
    if not is_finite.any():  # of a motion that was cut it is not known how far it came
        return end - standstill if end - standstill >= duration_of(trajectory) else 0.0

    # The begin of the motion, by thinned rows, and the last time at which the tip followed it in x and y.
    row_step = max(int(is_finite.sum()) // _MAX_ROWS, 1)
    time, place = time[is_finite], place[is_finite]
    delay = _delay(time[::row_step], place[::row_step], trajectory, standstill)
    distance = np.linalg.norm(trajectory.at(time - delay).position[:, :2] - place, axis=1)
    times_on_motion = time[distance < _MAX_DISTANCE]
    return (float(times_on_motion[-1]) if len(times_on_motion) else 0.0) - delay


def _delay(time: Floats, place: Floats, trajectory: Trajectory, min_delay: float) -> float:
    """Return the delay [s] of a motion's begin that explains recorded places (n, 2) [m] best; the latest of equals.

    With the latest nothing counts as done that was not.
    """
    delays = np.arange(min_delay, max(float(time[-1]), min_delay) + _DELAY_STEP, _DELAY_STEP)
    squares = [float(((trajectory.at(time - delay).position[:, :2] - place) ** 2).mean()) for delay in delays]
    best_rows = np.flatnonzero(np.array(squares) <= min(squares) + _DELAY_TOLERANCE)
    return float(delays[best_rows[-1]])


def resume(
    run: Annotated[Path, typer.Argument(help="The folder of the run that was interrupted.")],
    overrides: Overrides = None,
    yes: UnchangedOption = False,
) -> None:
    """Do the rest of an interrupted run: whole lines of a raster, whole points; in a folder inside the run's.

    The pipeline is used as recorded, and a rehearsal's in simulated time. Before a robot moves it is asked whether
    specimen and tool are still the same.
    """
    pipeline = remaining_pipeline(run, overrides or [])
    if pipeline is None:
        typer.echo(f"{run}: is complete; nothing is left to do")
        return
    demand_unchanged(pipeline, yes)
    execute(pipeline, RunFolder(run).next_part)
