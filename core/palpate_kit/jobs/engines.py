"""Engines on which jobs run: the cores of this machine, or the workers of a scheduler."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from palpate import ConfigurationError

if TYPE_CHECKING:
    from palpate_kit.jobs.job import Engine

SchedulerOption = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="ADDRESS",
        help='Run on the workers of a dask scheduler, such as "tcp://10.0.0.5:8786"; needs palpate[cluster].',
    ),
]


StageOption = Annotated[
    str | None,
    typer.Option(
        "--stage",
        metavar="URL",
        help='With --scheduler, where no folder is shared: inputs and runs pass through this, such as "s3://bucket/a".',
    ),
]


def demand_scheduler(scheduler: str | None, stage: str | None) -> None:
    """Raise ConfigurationError where there is a place for workers, and no workers."""
    if stage is not None and scheduler is None:
        raise ConfigurationError("--stage is for workers that share no folder with this machine: give --scheduler")


def demand_no_jobs(jobs: int | None) -> None:
    """Raise ConfigurationError where a number of jobs is asked for although workers run them."""
    if jobs is not None:
        raise ConfigurationError("--jobs is of this machine: with --scheduler, its workers say how many run at a time")


def engine_of(scheduler: str | None, jobs: int | None, folder: Path, stage: str | None = None) -> Engine:
    """Return the engine that the options ask for; raises ConfigurationError where they contradict each other."""
    demand_scheduler(scheduler, stage)
    if scheduler is None:
        from palpate_kit.jobs.cores import on_all_cores

        return partial(on_all_cores, workers=jobs)
    demand_no_jobs(jobs)
    from palpate_kit.jobs.cluster import on_cluster

    return on_cluster(scheduler, folder, stage)
