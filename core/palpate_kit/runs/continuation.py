"""Continuing a run: with its pipeline, and another motion."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from palpate import Trajectory
from palpate_engine import Pipeline, load_pipeline

from palpate_kit.runs.run_folder import RunFolder


def recorded_pipeline(folder: Path, overrides: Iterable[str] = ()) -> Pipeline:
    """The pipeline of a run as it was resolved, with ``table.key=value`` overrides on top.

    Raises LogError where the folder contains none, ConsentError where it names a plugin file that nobody has approved.
    """
    return load_pipeline(RunFolder(folder).pipeline, overrides, named=False)


def continue_pipeline(pipeline: Pipeline, trajectory: Trajectory, number: int) -> Pipeline:
    """A pipeline with another motion and another seed, so that its noise differs from that of the first run."""
    run = pipeline.run.model_copy(update={"seed": pipeline.run.seed + number})
    (name,) = pipeline.trajectories
    return replace(pipeline, run=run, trajectories={name: trajectory})
