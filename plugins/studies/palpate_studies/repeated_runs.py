"""One palpation made again and again: the ``[repeat]`` table, and a run folder for each."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import typer
from palpate import ConfigurationError, Device, PalpateError, UserError, clock, duration_of
from palpate_engine import Pipeline, check_motion, load_pipeline, make_folder, run_pipeline
from palpate_kit.jobs.engines import demand_scheduler
from palpate_kit.jobs.job import Job
from palpate_kit.terminal.progress import progress, report_progress

from palpate_studies.repeat_settings import RepeatSettings


@runtime_checkable
class ConditionedDevice(Protocol):
    """A simulated device whose specimen knows what was done to it."""

    def conditioned(self, earlier: Iterable[tuple[float, float]]) -> Device:
        """This device after palpations at distances [m] and ages [s]."""
        ...


def _settings(pipeline: Pipeline) -> RepeatSettings:
    settings = pipeline.tables.get("repeat")
    if not isinstance(settings, RepeatSettings):
        raise ConfigurationError(f"{pipeline.path}: has no table [repeat], such as [repeat] count = 50")
    return settings


def _by_the_clock(pipeline: Pipeline) -> bool:
    """Return True if something moves that takes its time: an arm, or a simulation that keeps the pace of one."""
    return any(device.live or getattr(device, "pace", "") == "real-time" for device in pipeline.devices.values())


def palpations(pipeline: Pipeline) -> Iterator[Pipeline]:
    """Yield the pipeline of each palpation: its own seed, its own name, and the motion moved on.

    Raises ConfigurationError where there is nothing to repeat, or where one of the motions breaks the limits.
    """
    settings = _settings(pipeline)
    if len(pipeline.trajectories) != 1:
        raise ConfigurationError(f"{pipeline.path}: [repeat] needs one trajectory, not {len(pipeline.trajectories)}")
    ((name, motion),) = pipeline.trajectories.items()
    way, pause = math.hypot(*settings.step), duration_of(motion) + settings.wait
    moved: Any = pipeline.registry.find("trajectory", "moved")
    for k in range(settings.count):
        run = pipeline.run.model_copy(
            update={"seed": pipeline.run.seed + k, "name": f"{pipeline.run.name} ({k + 1} of {settings.count})"}
        )
        there = moved(of=motion, by=tuple(k * step for step in settings.step)) if any(settings.step) else motion
        if pipeline.safety is not None and (problems := check_motion(there, pipeline.safety).problems):
            raise ConfigurationError(f"{pipeline.path}: palpation {k + 1} of {settings.count}: {'; '.join(problems)}")
        devices = {
            key: device.conditioned((m * way, m * pause) for m in range(1, k + 1))
            if isinstance(device, ConditionedDevice)
            else device
            for key, device in pipeline.devices.items()
        }
        yield replace(pipeline, run=run, trajectories={name: there}, devices=devices)


def perform(
    path: Path, overrides: Sequence[str], out: Path | None, scheduler: str | None = None, stage: str | None = None
) -> list[Path]:
    """Make every palpation of a pipeline file; their run folders, in one new folder.

    Nothing moves before all of them were checked, and after one that was stopped or failed nothing moves any more: each
    is a run of its own, with all its limits. Simulations can run on the workers of a scheduler. Raises UserError.
    """
    demand_scheduler(scheduler, stage)
    pipeline = load_pipeline(path if scheduler is None else path.resolve(), overrides)
    planned = list(palpations(pipeline))
    if scheduler is not None and _by_the_clock(pipeline):
        raise ConfigurationError(f"{path}: --scheduler is for simulations that keep no clock: an arm moves by itself")
    wait = _settings(pipeline).wait if _by_the_clock(pipeline) and pipeline.run.rehearsal is None else 0.0
    folder = make_folder(f"{pipeline.run.name}-repeated", out, datetime.now(UTC).astimezone())
    if scheduler is not None:
        return _spread(planned, folder, scheduler, stage)
    done: list[Path] = []
    try:
        for k, one in enumerate(planned, start=1):
            if done:
                clock().sleep(wait)
            with progress(f"palpation {k} of {len(planned)}", "s"):
                result = run_pipeline(one, _place(folder, k, len(planned)), report_progress)
            result.demand_whole()
            done.append(result.folder)
            typer.echo(f"palpation {k} of {len(planned)}: {result.folder}", err=True)
    except UserError:
        typer.echo(f"{len(done)} of {len(planned)} palpations are whole, in {folder}", err=True)
        raise
    typer.echo(f"to share it: palpate report {folder}/*", err=True)
    return done


def _place(folder: Path, number: int, count: int) -> Path:
    return folder / f"{number:0{len(str(count))}d}"


def _spread(planned: Sequence[Pipeline], folder: Path, scheduler: str, stage: str | None) -> list[Path]:
    """Return every palpation on the workers of a scheduler; raises PalpateError where one failed, when all have
    ended."""
    from palpate_kit.jobs.cluster import on_cluster

    count = len(planned)
    jobs = [Job(str(k), pipeline, _place(folder, k, count)) for k, pipeline in enumerate(planned, start=1)]
    done: dict[int, Path] = {}
    failures: dict[int, PalpateError] = {}
    with progress("palpations", "", count), closing(on_cluster(scheduler, folder, stage)(jobs)) as found:
        for job, outcome in found:
            if isinstance(outcome, PalpateError):
                failures[int(job.name)] = outcome
            else:
                done[int(job.name)] = outcome.result.folder
            report_progress(len(done) + len(failures))
    typer.echo(f"{len(done)} of {count} palpations are whole, in {folder}", err=True)
    if failures:
        raise failures[min(failures)]
    return [done[k] for k in sorted(done)]
