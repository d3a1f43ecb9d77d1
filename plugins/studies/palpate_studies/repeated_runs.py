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
    """A simulated device whose specimen remembers palpations."""

    def conditioned(self, earlier: Iterable[tuple[float, float]]) -> Device:
        """Return this device after earlier palpations, pairs of distance [m] and age [s]."""
        ...


def _repeat_settings(pipeline: Pipeline) -> RepeatSettings:
    """Return the table [repeat]; raises ConfigurationError without one."""
    settings = pipeline.tables.get("repeat")
    if not isinstance(settings, RepeatSettings):
        raise ConfigurationError(f"{pipeline.path}: has no table [repeat], such as [repeat] count = 50")
    return settings


def _takes_time(pipeline: Pipeline) -> bool:
    """Return True if a device moves in real time: an arm, or a simulation that keeps the pace of one."""
    return any(device.live or getattr(device, "pace", "") == "real-time" for device in pipeline.devices.values())


def palpations(pipeline: Pipeline) -> Iterator[Pipeline]:
    """Yield the pipeline of each palpation, with its own seed and name, its motion shifted by the step.

    Raises ConfigurationError without a table [repeat], and if one of the motions breaks the limits.
    """
    settings = _repeat_settings(pipeline)
    if len(pipeline.trajectories) != 1:
        raise ConfigurationError(f"{pipeline.path}: [repeat] needs one trajectory, not {len(pipeline.trajectories)}")
    ((name, motion),) = pipeline.trajectories.items()
    period = duration_of(motion) + settings.wait  # [s]
    moved_trajectory: Any = pipeline.registry.find("trajectory", "moved")
    for index in range(settings.count):
        title = f"{index + 1} of {settings.count}"
        update = {"seed": pipeline.run.seed + index, "name": f"{pipeline.run.name} ({title})"}
        run = pipeline.run.model_copy(update=update)
        shifted_motion = motion
        if any(settings.step):
            shifted_motion = moved_trajectory(of=motion, by=tuple(index * step for step in settings.step))
        if pipeline.safety is not None:
            problems = check_motion(shifted_motion, pipeline.safety).problems
            if problems:
                raise ConfigurationError(f"{pipeline.path}: palpation {title}: {'; '.join(problems)}")
        devices = _conditioned_devices(pipeline, index, settings, period)
        yield replace(pipeline, run=run, trajectories={name: shifted_motion}, devices=devices)


def _conditioned_devices(
    pipeline: Pipeline, earlier_count: int, settings: RepeatSettings, period: float
) -> dict[str, Device]:
    """Return the devices after a number of earlier palpations, each one step and one period [s] before the next."""
    distance = math.hypot(*settings.step)  # [m]
    devices: dict[str, Device] = {}
    for name, device in pipeline.devices.items():
        if isinstance(device, ConditionedDevice):
            earlier = ((m * distance, m * period) for m in range(1, earlier_count + 1))
            devices[name] = device.conditioned(earlier)
        else:
            devices[name] = device
    return devices


def perform(
    path: Path, overrides: Sequence[str], out: Path | None, scheduler: str | None = None, stage: str | None = None
) -> list[Path]:
    """Make every palpation of a pipeline file; return their run folders, which are in one new folder.

    Nothing moves before all motions were checked, and after one that was stopped or failed nothing moves any more: each
    is a run of its own, with all its limits. Simulations can run on the workers of a scheduler. Raises UserError.
    """
    demand_scheduler(scheduler, stage)
    pipeline = load_pipeline(path if scheduler is None else path.resolve(), overrides)
    planned = list(palpations(pipeline))
    takes_time = _takes_time(pipeline)
    if scheduler is not None and takes_time:
        raise ConfigurationError(f"{path}: --scheduler is for simulations that keep no clock: an arm moves by itself")
    folder = make_folder(f"{pipeline.run.name}-repeated", out, datetime.now(UTC).astimezone())
    if scheduler is not None:
        return _perform_on_cluster(planned, folder, scheduler, stage)
    # A simulation that is faster than time, and a rehearsal, do not wait.
    wait = _repeat_settings(pipeline).wait if takes_time and pipeline.run.rehearsal is None else 0.0
    run_folders: list[Path] = []
    try:
        for number, palpation in enumerate(planned, start=1):
            if run_folders:
                clock().sleep(wait)
            with progress(f"palpation {number} of {len(planned)}", "s"):
                result = run_pipeline(palpation, _run_folder(folder, number, len(planned)), report_progress)
            result.demand_whole()
            run_folders.append(result.folder)
            typer.echo(f"palpation {number} of {len(planned)}: {result.folder}", err=True)
    except UserError:
        typer.echo(f"{len(run_folders)} of {len(planned)} palpations are whole, in {folder}", err=True)
        raise
    typer.echo(f"to share it: palpate report {folder}/*", err=True)
    return run_folders


def _run_folder(folder: Path, number: int, count: int) -> Path:
    """Return the folder of a palpation by its number, with as many digits as the count of all."""
    return folder / f"{number:0{len(str(count))}d}"


def _perform_on_cluster(planned: Sequence[Pipeline], folder: Path, scheduler: str, stage: str | None) -> list[Path]:
    """Make palpations on the workers of a scheduler; return their run folders in order.

    Raises the PalpateError of the first one that failed, after all have ended.
    """
    from palpate_kit.jobs.cluster import on_cluster

    count = len(planned)
    jobs = [
        Job(str(number), pipeline, _run_folder(folder, number, count))
        for number, pipeline in enumerate(planned, start=1)
    ]
    run_folders: dict[int, Path] = {}  # by number
    failures: dict[int, PalpateError] = {}  # by number
    with progress("palpations", "", count), closing(on_cluster(scheduler, folder, stage)(jobs)) as outcomes:
        for job, outcome in outcomes:
            if isinstance(outcome, PalpateError):
                failures[int(job.name)] = outcome
            else:
                run_folders[int(job.name)] = outcome.result.folder
            report_progress(len(run_folders) + len(failures))
    typer.echo(f"{len(run_folders)} of {count} palpations are whole, in {folder}", err=True)
    if failures:
        raise failures[min(failures)]
    return [run_folders[number] for number in sorted(run_folders)]
