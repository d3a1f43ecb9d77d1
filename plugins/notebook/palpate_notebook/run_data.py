"""Data of a run: its result, tables of estimates, and samples, in memory or in a folder."""

from __future__ import annotations

import json
import shutil
import tomllib
import warnings
import weakref
from collections.abc import Iterator, Mapping
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar

import numpy as np
from palpate import ConfigurationError, Floats, LogError, Samples, suggest
from palpate_engine import (
    Pipeline,
    RecordOutcome,
    Result,
    acceleration,
    build_pipeline,
    is_live,
    resolved_text,
    run_pipeline,
)
from palpate_kit.runs.replay_source import read_run_log, replay_source
from palpate_kit.runs.run_folder import RunFolder, TrackTable

from palpate_notebook.run_functions import RunRecorder, quietly, run_place, write_run
from palpate_notebook.track_object import TrackView

if TYPE_CHECKING:
    import xarray

RunType = TypeVar("RunType", bound="RunData")
Recording = tuple[Samples | None, Mapping[str, TrackTable]]  # samples, and estimates by track


class RunData:
    """Result, samples and estimates of a run, and its folder."""

    def __init__(
        self,
        folder: Path | None,
        document: Mapping[str, Any],
        recording: Recording | None = None,
        *,
        temporary: bool = False,
        origin: Pipeline | None = None,
        record: object = None,
    ) -> None:
        """Keep the result of a run, with its folder, or with the recording and pipeline of a run in memory.

        A `temporary` folder is removed with this object. The `record` in memory is kept, since `origin` reads it.
        """
        self.document = document  # the contents of result.json [SI]
        self._folder = folder
        self._recording = recording
        self._origin = origin
        self._record = record
        if temporary and folder is not None:
            weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)

    @property
    def folder(self) -> Path:
        """The folder with all files of the run; that of a run in memory is written at the first request."""
        if self._folder is None:
            assert self._origin is not None  # a run without a folder is in memory
            self._folder = write_run(self._origin)
            weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        return self._folder

    @property
    def name(self) -> str:
        """The name of the run."""
        return str(self.document["run"]["name"])

    @property
    def tracks(self) -> dict[str, TrackView]:
        """The tracks by name, MODEL/ESTIMATOR."""
        return {name: self[name] for name in self.document["tracks"]}

    def __getitem__(self, track: str) -> TrackView:
        if track not in self.document["tracks"]:
            raise ConfigurationError(f"no track {track!r}{suggest(track, self.document['tracks'])}")
        return TrackView(track, self.document["tracks"][track], partial(getattr, self, "estimates"))

    def __iter__(self) -> Iterator[str]:
        return iter(self.document["tracks"])

    def __len__(self) -> int:
        return len(self.document["tracks"])

    @cached_property
    def pipeline(self) -> dict[str, Any]:
        """The resolved pipeline: every setting [SI], by table."""
        if self._origin is not None:
            return tomllib.loads(resolved_text(self._origin))
        return RunFolder(self.folder).settings

    @property
    def tip_mass(self) -> float:
        """Mass [kg] of all that hangs behind the sensor; 0 where it was not declared."""
        return float(self.pipeline["alignment"].get("tip_mass", 0.0))

    @property
    def truth(self) -> dict[str, float]:
        """The true values of a simulated rig, by parameter [SI]; empty for a real one."""
        return dict(self.document["truth"])

    @cached_property
    def estimates(self) -> xarray.Dataset:
        """The estimates of all tracks; dimensions track and time, units in the attributes."""
        from palpate_notebook.datasets import estimates_dataset

        return estimates_dataset(self.track_tables, self.document)

    @cached_property
    def samples(self) -> xarray.Dataset:
        """The aligned samples; dimension time, units in the attributes. Those of a run folder are read from its log.

        Raises LogError where the folder has no log.
        """
        from palpate_notebook.datasets import samples_dataset

        return samples_dataset(self.aligned)

    @property
    def track_tables(self) -> Mapping[str, TrackTable]:
        """The estimates of every track as arrays."""
        return self._recording[1] if self._recording is not None else RunFolder(self.folder).tracks

    @cached_property
    def aligned(self) -> Samples:
        """The aligned samples as arrays; raises LogError like `samples`."""
        samples = self._recording[0] if self._recording is not None else self.replay()._recorded_samples
        if samples is None:
            raise LogError(f"{self.name}: the record contains no samples")
        return samples

    @cached_property
    def contact_force(self) -> Floats:
        """Force (n,) [N] on the tip at each sample: that of the sensor, plus tip mass times acceleration.

        Raises LogError like `samples`.
        """
        tip_acceleration = np.nan_to_num(acceleration(self.aligned.time, self.aligned.velocity))
        return np.asarray(self.aligned.force + self.tip_mass * tip_acceleration)

    @property
    def _recorded_samples(self) -> Samples | None:
        return self._recording[0] if self._recording is not None else None

    def replay(self) -> Self:
        """Return the run repeated from its log, to the same estimates; raises LogError where it has none."""
        run_log = read_run_log(self.folder)
        if run_log is None:
            raise LogError(f"{self.folder}: has no log that carries its pipeline")
        return execute(type(self), build_pipeline(replay_source(run_log)), None)


def execute(run_class: type[RunType], pipeline: Pipeline, folder: Path | None) -> RunType:
    """Run a pipeline into a folder, and return the run as an object of a class.

    Without a `folder` it is a temporary one that is removed with the object, or, for live devices, one in runs/.
    Raises UserError, and StoppedError where the run was stopped.
    """
    for notice in pipeline.notices:
        warnings.warn(notice, stacklevel=3)
    temporary = folder is None and not is_live(pipeline.devices)
    recorder = RunRecorder({track.name: track.model.parameters for track in pipeline.tracks})
    with run_place(folder, temporary) as run_folder, quietly():
        result = run_pipeline(pipeline, run_folder, observer=recorder)
        result.demand_whole()
    recording = recorder.joined, recorder.tables(result.tracks)
    return run_class(result.folder, _document(result), recording, temporary=temporary)


def finished_run(run_class: type[RunType], outcome: RecordOutcome, record: object) -> RunType:
    """Return the run of a record in memory as an object of a class, which keeps the record."""
    recorder = RunRecorder.of(outcome)
    samples = recorder.joined if len(outcome.samples) else None
    recording = samples, recorder.tables(outcome.result.tracks)
    return run_class(None, _document(outcome.result), recording, origin=outcome.pipeline, record=record)


def _document(result: Result) -> dict[str, Any]:
    """Return a result as it is read from result.json."""
    document: dict[str, Any] = json.loads(json.dumps(result.table()))
    return document
