"""Pipelines run as they are on the workers of a scheduler: each a run folder that is found, and not made twice."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

from palpate import ConfigurationError, UserError
from palpate.host import Pipeline, Result, RunFolder, registry, run_pipeline

from palpate_studies.answers import keep, kept
from palpate_studies.cluster import connected, lost, spread
from palpate_studies.jobs import demand_same


@dataclass(frozen=True)
class ClusterRun:
    """One pipeline to be run as it is, by any process, into a folder that no earlier attempt has used."""

    name: str
    pipeline: Pipeline
    folder: Path


@dataclass(frozen=True)
class Answer:
    """What a run has found, and what else whoever asked for it wants of it."""

    result: Result
    more: Any = None


Work = Callable[[ClusterRun], Answer]  # for any process; raises UserError


def run_or_find(run: ClusterRun) -> Answer:
    """The result of a run that nobody has stopped: found where an earlier attempt has made it. Raises UserError."""
    if (found := found_before(run)) is not None:
        return Answer(found)
    result = run_pipeline(run.pipeline, unused(run.folder))
    result.demand_whole()
    keep(result)
    return Answer(result)


def found_before(run: ClusterRun) -> Result | None:
    """What an earlier attempt has found, where it is whole; raises OutputError where that was with other settings."""
    for folder in _attempts(run.folder):
        if not folder.exists():
            return None
        if (found := kept(folder)) is not None:
            demand_same(run.pipeline, RunFolder(folder), run.name)
            return found
    return None


def unused(folder: Path) -> Path:
    """The folder, or one beside it where an earlier attempt has left something, as a worker does that was killed."""
    return next(path for path in _attempts(folder) if not path.exists())


def _attempts(folder: Path) -> Iterator[Path]:
    yield folder
    yield from (folder.with_name(f"{folder.name}.{attempt}") for attempt in count(2))


def cluster_results(
    address: str, folder: Path, runs: Sequence[ClusterRun], stage: str | None = None, work: Work = run_or_find
) -> Generator[tuple[ClusterRun, Answer | UserError]]:
    """What the workers of a scheduler find, in any order, or why they find nothing; runs are in folders of this one.

    With a `stage` the workers need not see the folder: inputs and run folders go by way of that place.
    """
    from palpate_studies.staging import Stage, StagedRun, answer_staged, brought

    with connected(address, folder, shared=stage is None) as client:
        everywhere = {run.name: replace(run, folder=run.folder.resolve()) for run in runs}
        parcels = (Parcel.of(run) for run in everywhere.values())
        place = None if stage is None else Stage(stage)
        done: Generator[tuple[Any, Any]]
        if place is None:
            done = spread(client, _Tried(work), parcels)
        else:
            inputs = place.put_inputs(run.pipeline for run in runs)
            done = spread(client, answer_staged, (StagedRun(parcel, work, place, inputs) for parcel in parcels))
        with closing(done):
            for task, outcome in done:
                if not isinstance(outcome, Answer | UserError):
                    outcome = UserError(lost(outcome))
                run = everywhere[task.name]
                yield run, outcome if place is None else brought(run, place, outcome)


@dataclass(frozen=True)
class Parcel:
    """A run on its way to a worker, which imports the plugin files that its parts are of before it unpacks it."""

    name: str
    plugins: tuple[Path, ...]
    content: bytes

    @classmethod
    def of(cls, run: ClusterRun) -> Parcel:
        """A run, packed; raises ConfigurationError where it cannot be."""
        try:
            return cls(run.name, run.pipeline.run.plugins, pickle.dumps(run))
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise ConfigurationError(
                f"{run.name}: cannot be sent to workers: {error}; install what is in a plugin file as a distribution"
            ) from error

    def unpacked(self) -> ClusterRun:
        """The run; raises PluginError where a plugin file is not there."""
        if self.plugins:
            registry.load(self.plugins)
        run: ClusterRun = pickle.loads(self.content)
        return run


@dataclass(frozen=True)
class _Tried:
    """A work whose UserError is an outcome like any other."""

    work: Work

    def __call__(self, parcel: Parcel) -> Answer | UserError:
        try:
            return self.work(parcel.unpacked())
        except UserError as error:
            return error
