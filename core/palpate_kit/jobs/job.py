"""Jobs: runs that any process on any machine can make, each into a folder of its own, and none of them twice."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

from palpate import ConfigurationError, OutputError, PalpateError, UserError
from palpate_engine import (
    Pipeline,
    PluginSwitch,
    Result,
    Source,
    announce,
    approved_files,
    approved_plugins,
    build_pipeline,
    inherited_approval,
    only_plugins,
    plugin_files,
    registry,
    resolved_text,
    run_pipeline,
)

from palpate_kit.jobs.result_cache import read_cached, write_cache
from palpate_kit.runs.pipeline_diff import differences
from palpate_kit.runs.run_folder import RunFolder


class OtherSettingsError(OutputError):
    """Runs in a folder that were made with other settings."""


@dataclass(frozen=True)
class RunAnswer:
    """Result of a run, and what else its caller asked for."""

    result: Result
    more: Any = None


Outcome = RunAnswer | PalpateError  # StoppedError where somebody stopped the run, which then says nothing of the job


def run_or_find(job: Job) -> RunAnswer:
    """Return the result of a run that nobody has stopped: found where an earlier attempt has made it. Raises
    PalpateError."""
    if (earlier_result := cached_result(job)) is not None:
        return RunAnswer(earlier_result)
    result = run_pipeline(job.pipeline(), unused_folder(job.folder))
    result.demand_whole()
    write_cache(result)
    return RunAnswer(result)


@dataclass(frozen=True)
class PortablePipeline:
    """A pipeline as plain data, built where it is used."""

    text: str  # of the pipeline file
    path: Path  # where the file stands: what is relative in it is relative to here
    overrides: tuple[str, ...] = ()  # "table.key=value"
    named: bool = False  # by a person; see `Source`

    @property
    def source(self) -> Source:
        """The text with the overrides; raises ConfigurationError."""
        source = Source(self.text, self.path, self.named)
        for assignment in self.overrides:
            source.override(assignment)
        return source

    def pipeline(self) -> Pipeline:
        """Return the pipeline; raises UserError where it has a mistake."""
        return build_pipeline(self.source)


@dataclass(frozen=True)
class Job:
    """One run, to be made by any process into a folder that no earlier attempt has used."""

    name: str  # no other job of an engine has it
    plan: Pipeline | PortablePipeline
    folder: Path
    work: Callable[[Job], RunAnswer] = run_or_find  # raises PalpateError

    def pipeline(self) -> Pipeline:
        """Return the pipeline; raises UserError where it has a mistake."""
        return self.plan.pipeline() if isinstance(self.plan, PortablePipeline) else self.plan

    def pipelines(self) -> list[Pipeline]:
        """Return all pipelines that the job reads; raises UserError where one has a mistake."""
        return [self.pipeline()]

    def placed(self) -> Job:
        """Return the job with paths that mean the same wherever it runs."""
        plan = (
            replace(self.plan, path=self.plan.path.resolve()) if isinstance(self.plan, PortablePipeline) else self.plan
        )
        return replace(self, plan=plan, folder=self.folder.resolve())


Engine = Callable[[Sequence[Job]], Generator[tuple[Job, Outcome]]]  # outcomes in any order


def run_job(job: Job) -> Outcome:
    """Return what a job comes to, or why to nothing."""
    try:
        return job.work(job)
    except PalpateError as error:
        return error
    except Exception as error:  # one broken plugin must not end a night's sweep
        return PalpateError(f"{type(error).__name__}: {error}")


def cached_result(job: Job) -> Result | None:
    """Return the result of an earlier attempt, where it is whole.

    Raises OtherSettingsError where that was with other settings.
    """
    for folder in _attempts(job.folder):
        if not folder.exists():
            return None
        if (run := RunFolder(folder)).finished and (result := read_cached(folder)) is not None:
            demand_same(job.pipeline(), run, job.name)
            return result
    return None


def unused_folder(folder: Path) -> Path:
    """Return the folder, or one next to it where an earlier attempt has left something, as a process does that was
    killed."""
    return next(path for path in _attempts(folder) if not path.exists())


def _attempts(folder: Path) -> Iterator[Path]:
    yield folder
    yield from (folder.with_name(f"{folder.name}.{attempt}") for attempt in count(2))


def demand_same(pipeline: Pipeline, run: RunFolder, name: str) -> None:
    """Raise OtherSettingsError where a run, `name`, was made with other settings than a pipeline has now."""
    text = differences(resolved_text(pipeline), run.pipeline_text, pipeline.registry.tables)
    if text:
        raise OtherSettingsError(
            f"{run.path}: {name} was run with other settings: {text}; nothing is mixed: give --out another folder, or "
            "the settings of then"
        )


@dataclass(frozen=True)
class Parcel:
    """A job on its way to another process, which imports the plugin files that its parts are of before it unpacks.

    The process decides nothing: it executes the content that was approved where the parcel was made, and no other.
    """

    name: str
    plugins: tuple[Path, ...]
    approved: frozenset[str]  # SHA-256
    content: bytes
    distributions: str  # what PALPATE_PLUGINS says where the parcel was made

    @classmethod
    def of(cls, job: Job) -> Parcel:
        """Return a job, packed with its plugin files; raises ConfigurationError where it cannot be pickled."""
        plugins: tuple[Path, ...] = ()
        # A portable pipeline is built by the worker, a built one is pickled.
        if isinstance(job.plan, PortablePipeline):
            with suppress(UserError):  # which the job, which cannot be done, reports
                announce(plugin_files(job.plan.source))
        else:
            plugins = job.plan.run.plugins
        try:
            switch = PluginSwitch.of_environment().text
            return cls(job.name, plugins, approved_plugins(), pickle.dumps(job), switch)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise ConfigurationError(
                f"{job.name}: cannot be sent to another process: {error}; install what is in a plugin file as a "
                "distribution"
            ) from error

    @contextmanager
    def unpacked(self) -> Iterator[Job]:
        """Yield the job, to be done within the context; raises PluginError where a plugin file is missing or has
        changed."""
        with only_plugins(self.distributions), inherited_approval(self.approved):
            if self.plugins:
                registry.load(approved_files(self.plugins, Path(), named=False))
            yield pickle.loads(self.content)


def run_parcel(parcel: Parcel) -> Outcome:
    """Return what the job in a parcel comes to; for any process on any machine."""
    try:
        with parcel.unpacked() as job:
            return run_job(job)
    except PalpateError as error:
        return error
