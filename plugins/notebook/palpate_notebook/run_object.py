"""A finished run: what it found, as tables, numbers, arrays and pictures."""

from __future__ import annotations

import shutil
import tomllib
import weakref
from collections.abc import Iterator, Mapping
from contextlib import redirect_stdout
from functools import cached_property
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from palpate import ConfigurationError, Flag, Floats, LogError, OutputError, Samples, suggest
from palpate_engine import Pipeline, acceleration, analysis, build_pipeline, resolved_text
from palpate_kit.runs.replay_source import read_run_log, replay_source
from palpate_kit.runs.result_file import read_flags
from palpate_kit.runs.run_folder import RunFolder, TrackTable

from palpate_notebook.plotting import Plots
from palpate_notebook.run_html import run_html, run_text
from palpate_notebook.suggestions import with_suggestions
from palpate_notebook.track_object import TrackView

if TYPE_CHECKING:
    import pandas
    import xarray

    from palpate_notebook.map_object import MapView

Found = tuple[Samples | None, Mapping[str, TrackTable]]


@with_suggestions
class FinishedRun:
    """What a run found; `run["dr/ekf"]` is one of its tracks."""

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
            from palpate_notebook.run_functions import write_run

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
        return {name: TrackView(self, name) for name in self.document["tracks"]}

    def __getitem__(self, track: str) -> TrackView:
        if track not in self.document["tracks"]:
            raise ConfigurationError(f"there is no track {track!r}{suggest(track, self.document['tracks'])}")
        return TrackView(self, track)

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
    def flags(self) -> dict[str, tuple[Flag, ...]]:
        """Flags on each track, by its name."""
        return {name: read_flags(track["flags"]) for name, track in self.document["tracks"].items()}

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

    def replay(self) -> FinishedRun:
        """The run repeated from its log, to the same estimates; raises LogError where it has none."""
        from palpate_notebook.run_functions import execute

        carried = read_run_log(self.folder)
        if carried is None:
            raise LogError(f"{self.folder}: has no log that carries its pipeline")
        return execute(build_pipeline(replay_source(carried)), None)

    def summary(self, si: bool = False) -> pandas.DataFrame:
        """A row for each track and parameter: value, std, combined, unit, verdict; in display units, or SI."""
        from palpate_notebook.data_frames import summary_frame

        return summary_frame(self.document, si)

    @property
    def plot(self) -> Plots:
        """Pictures: ``run.plot()``, ``run.plot.force_depth()``, ``run.plot.force()``."""
        return Plots(self)

    def map(
        self,
        track: str | None = None,
        parameter: str | None = None,
        cell: str | float = "1 mm",
        method: Literal["gaussian-process", "average"] = "gaussian-process",
    ) -> MapView:
        """The map of a parameter over the places of the run, or its curve along a line.

        By default of its best track's first parameter. Raises LogError where there are too few places.
        """
        from palpate_notebook.map_object import map_of

        return map_of(self, track, parameter, cell, method)

    def report(self, path: str | Path = "report.html") -> Path:
        """One page on the run to hand on, its verdict first: `palpate report`; raises UserError."""
        place = Path(path)
        with redirect_stdout(StringIO()):  # the command says where it is written
            analysis("report")([self.folder], out=place)
        return place

    def save(self, folder: str | Path) -> Path:
        """Keep everything that the run wrote in a new folder; raises OutputError where there is something already."""
        place = Path(folder)
        try:
            shutil.copytree(self.folder, place)
        except FileExistsError as error:
            raise OutputError(f"{place}: exists already, and nothing is ever overwritten") from error
        except OSError as error:
            raise OutputError(f"{place}: cannot write: {error.strerror or error}") from error
        return place

    def __repr__(self) -> str:
        return run_text(self.document)

    def _repr_html_(self) -> str:
        return run_html(self.document)


def open_run(folder: str | Path) -> FinishedRun:
    """A run that was made before, from its folder; raises LogError where it is none."""
    place = Path(folder)
    return FinishedRun(place, RunFolder(place).result)
