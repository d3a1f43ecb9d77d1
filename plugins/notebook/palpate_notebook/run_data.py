"""What a run found, as data: its document, tables of estimates and samples, in memory or in a folder."""

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

Kind = TypeVar("Kind", bound="RunData")
Found = tuple[Samples | None, Mapping[str, TrackTable]]


class RunData:
    """Document, samples and estimates of a run, and the folder of what it wrote."""

    def __init__(
        self,
        folder: Path | None,
        document: Mapping[str, Any],
        found: Found | None = None,
        *,
        temporary: bool = False,
        origin: Pipeline | None = None,
        holds: object = None,
    ) -> None:
        self.document = document  # the contents of result.json [SI]
        self._folder, self._found, self._origin, self._holds = folder, found, origin, holds
        if temporary and folder is not None:
            weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)

    @property
    def folder(self) -> Path:
        """The folder with everything that the run wrote; of a run in memory it is made when it is first asked for."""
        if self._folder is None:
            assert self._origin is not None  # of a run in memory
            self._folder = write_run(self._origin)
            weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        return self._folder

    @property
    def name(self) -> str:
        """What the run is called."""
        return str(self.document["run"]["name"])

    @property
    def tracks(self) -> dict[str, TrackView]:
        """Every track by its name, MODEL/ESTIMATOR."""
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
        """The pipeline as it was resolved: every setting [SI], by table."""
        if self._origin is not None:
            return tomllib.loads(resolved_text(self._origin))
        return RunFolder(self.folder).settings

    @property
    def tip_mass(self) -> float:
        """Mass of all that hangs behind the sensor [kg], 0 where it was not declared."""
        return float(self.pipeline["alignment"].get("tip_mass", 0.0))

    @property
    def truth(self) -> dict[str, float]:
        """The true values of a simulated rig, by parameter [SI]; empty for everything else."""
        return dict(self.document["truth"])

    @cached_property
    def estimates(self) -> xarray.Dataset:
        """The estimates of all tracks; dimensions track and time, units in the attributes."""
        from palpate_notebook.datasets import estimates_dataset

        return estimates_dataset(self.track_tables, self.document)

    @cached_property
    def samples(self) -> xarray.Dataset:
        """The aligned samples; dimension time, units in the attributes. Of a run folder they are made from its log.

        Raises LogError where the folder has no log.
        """
        from palpate_notebook.datasets import samples_dataset

        return samples_dataset(self.aligned)

    @property
    def track_tables(self) -> Mapping[str, TrackTable]:
        """The estimates of every track as arrays."""
        return self._found[1] if self._found is not None else RunFolder(self.folder).tracks

    @cached_property
    def aligned(self) -> Samples:
        """The aligned samples as arrays; raises LogError like `samples`."""
        samples = self._found[0] if self._found is not None else self.replay()._whole
        if samples is None:
            raise LogError(f"{self.name}: the record contains no samples")
        return samples

    @cached_property
    def contact_force(self) -> Floats:
        """Force (n,) [N] on the tip itself, at each sample: the sensor's, and the inertia of what hangs behind it.

        Raises LogError like `samples`.
        """
        moved = np.nan_to_num(acceleration(self.aligned.time, self.aligned.velocity))
        return np.asarray(self.aligned.force + self.tip_mass * moved)

    @property
    def _whole(self) -> Samples | None:
        return self._found[0] if self._found is not None else None

    def replay(self) -> Self:
        """Return the run repeated from its log, to the same estimates; raises LogError where it has none."""
        carried = read_run_log(self.folder)
        if carried is None:
            raise LogError(f"{self.folder}: has no log that carries its pipeline")
        return execute(type(self), build_pipeline(replay_source(carried)), None)


def execute(kind: type[Kind], pipeline: Pipeline, folder: Path | None, holds: object = None) -> Kind:
    """Run a pipeline; without a `folder` into one that goes with the result, or, of live devices, into runs/.

    The result keeps what it `holds`. Raises UserError, and StoppedError where the run was stopped.
    """
    for notice in pipeline.notices:
        warnings.warn(notice, stacklevel=3)
    live = is_live(pipeline.devices)
    temporary = folder is None and not live
    kept = RunRecorder({track.name: track.model.parameters for track in pipeline.tracks})
    with run_place(folder, temporary) as place, quietly():
        result = run_pipeline(pipeline, place, observer=kept)
        result.demand_whole()
    found = kept.joined, kept.tables(result.tracks)
    return kind(result.folder, _document(result), found, temporary=temporary, holds=holds)


def finished_run(kind: type[Kind], outcome: RecordOutcome, holds: object) -> Kind:
    """Return the outcome of a record in memory as a run, which keeps what it `holds`."""
    kept = RunRecorder.of(outcome)
    samples = kept.joined if len(outcome.samples) else None
    found = samples, kept.tables(outcome.result.tracks)
    return kind(None, _document(outcome.result), found, origin=outcome.pipeline, holds=holds)


def _document(result: Result) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(json.dumps(result.table()))
    return document
