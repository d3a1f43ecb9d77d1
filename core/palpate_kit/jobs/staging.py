"""Jobs where no folder is shared: inputs and run folders pass through an object store, or whatever fsspec reaches."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from palpate import ConfigurationError, OutputError, PalpateError
from palpate_engine import RESULT, Pipeline
from pydantic import BaseModel

from palpate_kit.jobs.job import Job, Outcome, Parcel, RunAnswer, cached_result, run_job, unused_folder
from palpate_kit.jobs.workers import GO_ON


@dataclass(frozen=True)
class Stage:
    """A place such as ``s3://bucket/sweep`` that this machine and all workers reach; nothing else is common to them."""

    url: str

    def _reached(self) -> tuple[Any, str]:
        """Return the file system of the place, and where in it; raises ConfigurationError."""
        try:
            import fsspec

            files, root = fsspec.core.url_to_fs(self.url)
        except ImportError as error:
            raise ConfigurationError(f'--stage {self.url}: {error}; pip install "palpate[cluster]"') from error
        except ValueError as error:
            raise ConfigurationError(f"--stage {self.url}: {error}") from error
        return files, root.rstrip("/")

    @contextmanager
    def _access(self) -> Generator[tuple[Any, str]]:
        """Yield the same while something is asked of it; raises OutputError where it does not answer, however often
        asked."""
        files, root = self._reached()
        try:
            yield files, root
        except PalpateError:
            raise
        except Exception as error:  # each store's library has errors of its own
            raise OutputError(f"--stage {self.url}: {type(error).__name__}: {error}; {GO_ON}") from error

    def put_inputs(self, pipelines: Iterable[Pipeline]) -> dict[str, str]:
        """Put every file that pipelines name into the place, once; SHA-256 by path.

        Raises OutputError where the place cannot be written to.
        """
        digests: dict[str, str] = {}
        with self._access() as (files, root):
            for path in (path for pipeline in pipelines for path in input_files(pipeline)):
                if str(path) in digests:
                    continue
                digests[str(path)] = digest = _digest(path)
                if not files.exists(f"{root}/inputs/{digest}"):
                    _put(files, path, f"{root}/inputs/{digest}")
        return digests

    def get_inputs(self, digests: Mapping[str, str]) -> None:
        """Put inputs to where they are on the machine that asks; raises OutputError where something else is there."""
        with self._access() as (files, root):
            for text, digest in digests.items():
                self._get_input(files, f"{root}/inputs/{digest}", Path(text), digest)

    def _get_input(self, files: Any, source: str, path: Path, digest: str) -> None:
        """Copy an input file and verify its digest; a file that is there must be the same. Raises OutputError."""
        if path.exists():
            if _digest(path) != digest:
                raise OutputError(f"{path}: this worker has another file of that name")
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".") as beside:
            partial = Path(beside, path.name)
            files.get_file(source, str(partial))
            if _digest(partial) != digest:
                raise OutputError(f"--stage {self.url}: {path} is not whole there: remove inputs/{digest}")
            os.replace(partial, path)

    def holds(self, run: str) -> bool:
        """Return True if a run is whole in the place."""
        with self._access() as (files, root):
            return bool(files.exists(f"{root}/runs/{run}/{RESULT}"))

    def put_run(self, folder: Path, run: str) -> None:
        """Put a run folder into the place, its result last."""
        inside = sorted((path for path in folder.rglob("*") if path.is_file()), key=lambda path: path.name == RESULT)
        with self._access() as (files, root):
            for path in inside:
                _put(files, path, f"{root}/runs/{run}/{path.relative_to(folder).as_posix()}")

    def get_run(self, run: str, folder: Path) -> None:
        """Bring a run here, into a folder that is not there yet: whole or not at all."""
        with self._access() as (files, root), tempfile.TemporaryDirectory(dir=folder.parent, prefix=".") as partial:
            source = f"{root}/runs/{run}"
            for path in files.find(source):
                target = Path(partial, "run", path.removeprefix(source).lstrip("/"))
                target.parent.mkdir(parents=True, exist_ok=True)
                files.get_file(path, str(target))
            os.replace(Path(partial, "run"), folder)


@dataclass(frozen=True)
class StagedJob:
    """A job with the place of its inputs and of its run folder."""

    parcel: Parcel
    stage: Stage
    inputs: Mapping[str, str]  # SHA-256 by path

    @property
    def name(self) -> str:
        """Name of the job."""
        return self.parcel.name


def run_staged(staged: StagedJob) -> Outcome:
    """Run a job on a worker that shares no folder, and put its run folder into the place; return the outcome.

    A run that is whole in the place already is brought from there, and not made again.
    """
    stage = staged.stage
    try:
        stage.get_inputs(staged.inputs)
        with staged.parcel.unpacked() as job, tempfile.TemporaryDirectory(prefix="palpate-") as temporary:
            folder = Path(temporary, job.folder.name)
            whole = stage.holds(job.folder.name)
            if whole:
                stage.get_run(job.folder.name, folder)
            outcome = run_job(replace(job, folder=folder))
            # A job may have an answer and no folder.
            is_run = isinstance(outcome, RunAnswer) and outcome.result.folder.is_dir()
            if isinstance(outcome, RunAnswer) and is_run and (not whole or outcome.result.folder != folder):
                stage.put_run(outcome.result.folder, job.folder.name)
    except PalpateError as error:
        return error
    return outcome


def brought(job: Job, stage: Stage, outcome: Outcome) -> Outcome:
    """Return an outcome with its run folder brought here; raises OutputError where that cannot be."""
    if not isinstance(outcome, RunAnswer) or not outcome.result.run:
        return outcome
    if (result := cached_result(job)) is None:
        folder = unused_folder(job.folder)
        stage.get_run(job.folder.name, folder)
        result = replace(outcome.result, folder=folder)
    return replace(outcome, result=result)


def input_files(pipeline: Pipeline) -> Iterator[Path]:
    """Yield every file that a pipeline's settings name and that is there; of a folder, such as a bag, all that is in
    it."""
    parts = (pipeline.devices, pipeline.indenters, pipeline.models, pipeline.estimators, pipeline.trajectories)
    for path in _paths([pipeline.run, pipeline.safety, *parts, pipeline.surfaces, pipeline.sinks, pipeline.tables]):
        whole = Path(os.path.abspath(path))
        yield from filter(Path.is_file, sorted(whole.rglob("*")) if whole.is_dir() else [whole])


def _paths(value: Any) -> Iterator[Path]:
    """Yield the paths in settings, tables and lists."""
    if isinstance(value, Path):
        yield value
    elif isinstance(value, BaseModel):
        yield from _paths([getattr(value, name) for name in type(value).model_fields])
    elif isinstance(value, Mapping):
        yield from _paths(list(value.values()))
    elif isinstance(value, list | tuple | set | frozenset):
        for item in value:
            yield from _paths(item)


def _put(files: Any, path: Path, target: str) -> None:
    files.makedirs(target.rpartition("/")[0], exist_ok=True)
    files.put_file(str(path), target)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
