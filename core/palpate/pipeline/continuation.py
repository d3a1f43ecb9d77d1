"""Going on with a run: what an interruption left, or further places, in a folder inside the run's."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

from palpate.config import Pipeline, load_pipeline
from palpate.errors import ConfigurationError, LogError
from palpate.trajectory import Trajectory

_CAUTION = 0.5  # [s]; what ended this much before the record did is taken for finished


def parts_of(folder: Path) -> list[Path]:
    """The folder of a run and those of its continuations, in their order."""
    return [folder, *sorted(folder.glob("part-*"), key=lambda part: int(part.name.rpartition("-")[2]))]


def next_part(folder: Path) -> Path:
    """The folder of the next continuation; not made yet."""
    return folder / f"part-{len(parts_of(folder)) + 1}"


def recorded_pipeline(folder: Path) -> Pipeline:
    """The pipeline of a run as it was resolved; raises LogError where the folder holds none."""
    path = folder / "resolved.toml"
    if not path.is_file():
        raise LogError(f"{folder}: is no run folder: it has no resolved.toml")
    return load_pipeline(path)


def remaining_pipeline(folder: Path) -> Pipeline | None:
    """The pipeline that does what an interrupted run left undone, or None where it was finished.

    Raises ConfigurationError where its motion can only be done as one.
    """
    last = parts_of(folder)[-1]
    pipeline = recorded_pipeline(last)
    if len(pipeline.trajectories) != 1:
        raise ConfigurationError(f"{last}: moves nothing, so there is nothing to resume")
    ((name, trajectory),) = pipeline.trajectories.items()
    elapsed = recorded_time(last)
    if elapsed >= trajectory.total_duration - _CAUTION:
        return None
    rest = trajectory.after(elapsed - _CAUTION)
    if rest is None:
        if type(trajectory).after is Trajectory.after:
            raise ConfigurationError(f"{last}: [trajectory.{name}] can only be done as one; run it again")
        return None
    return continued(pipeline, rest, len(parts_of(folder)))


def continued(pipeline: Pipeline, trajectory: Trajectory, number: int) -> Pipeline:
    """A pipeline with another motion and another seed, so that its noise is not that of the first run again."""
    run = pipeline.run.model_copy(update={"seed": pipeline.run.seed + number})
    (name,) = pipeline.trajectories
    return replace(pipeline, run=run, trajectories={name: trajectory})


def recorded_time(folder: Path) -> float:
    """Time [s] of the last whole row of a run's table of estimates; 0 where there is none."""
    path = folder / "estimates.csv"
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = csv.reader(file)
            width, last = len(next(rows, [])), 0.0
            for row in rows:
                if len(row) == width:
                    last = float(row[0])
    except (OSError, ValueError) as error:
        raise LogError(f"{path}: cannot be read: {error}") from error
    return last
