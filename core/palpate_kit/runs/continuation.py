"""Continuing a run: with its pipeline, and another motion; that of a rehearsal in simulated time only."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import typer
from palpate import ConfigurationError, Trajectory
from palpate_engine import Pipeline, is_live, load_pipeline

from palpate_kit.runs.run_folder import RunFolder


def recorded_pipeline(folder: Path, overrides: Iterable[str] = ()) -> Pipeline:
    """Return the pipeline of a run as it was resolved, with ``table.key=value`` overrides on top; a rehearsal's stays
    one.

    Raises LogError where the folder contains none, ConsentError where it names a plugin file that nobody has approved.
    """
    run = RunFolder(folder)
    kept = [] if run.rehearsal is None else [f"run.rehearsal={json.dumps(run.rehearsal)}"]
    return load_pipeline(run.pipeline, [*overrides, *kept], named=False)


def continue_pipeline(pipeline: Pipeline, trajectory: Trajectory, number: int) -> Pipeline:
    """Return a pipeline with another motion and another seed, so that its noise differs from that of the first run."""
    run = pipeline.run.model_copy(update={"seed": pipeline.run.seed + number})
    (name,) = pipeline.trajectories
    return replace(pipeline, run=run, trajectories={name: trajectory})


def demand_unchanged(pipeline: Pipeline, yes: bool) -> None:
    """Ask whether specimen and tool are those of the run that is continued; of a simulated one nothing is asked.

    Raises ConfigurationError where they are not, or nobody answers.
    """
    where = f"the pipeline is used as recorded ({pipeline.path})"
    if pipeline.run.rehearsal is not None:
        typer.echo(f"{where}, in simulated time as the rehearsal was: nothing real moves", err=True)
        return
    typer.echo(where, err=True)
    if yes or not is_live(pipeline.devices):
        return
    question = "are specimen and tool still the same, and where they were?"
    try:
        answer = typer.confirm(question, default=False, err=True)
    except (EOFError, typer.Abort) as error:
        raise ConfigurationError(f"{question} no answer; --yes continues without asking") from error
    if not answer:
        raise ConfigurationError("nothing was moved: another specimen or tool is another run, of a folder of its own")
