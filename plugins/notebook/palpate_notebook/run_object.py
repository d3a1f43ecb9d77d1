"""A finished run: what it found, as tables, numbers, arrays and pictures."""

from __future__ import annotations

import shutil
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from palpate import Flag, OutputError
from palpate_engine import analysis
from palpate_kit.runs.result_file import read_flags
from palpate_kit.runs.run_folder import RunFolder

from palpate_notebook.plotting import Plots
from palpate_notebook.run_data import RunData
from palpate_notebook.run_html import run_html, run_text
from palpate_notebook.suggestions import with_suggestions

if TYPE_CHECKING:
    import pandas

    from palpate_notebook.map_object import MapView


@with_suggestions
class FinishedRun(RunData):
    """What a run found; `run["dr/ekf"]` is one of its tracks."""

    @property
    def flags(self) -> dict[str, tuple[Flag, ...]]:
        """Flags on each track, by its name."""
        return {name: read_flags(track["flags"]) for name, track in self.document["tracks"].items()}

    def summary(self, si: bool = False) -> pandas.DataFrame:
        """Return a row for each track and parameter: value, std, combined, unit, verdict; in display units, or SI."""
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
        """Return the map of a parameter over the places of the run, or its curve along a line.

        By default of its best track's first parameter. Raises LogError where there are too few places.
        """
        from palpate_notebook.map_object import map_of

        return map_of(self, track, parameter, cell, method)

    def report(self, path: str | Path = "report.html") -> Path:
        """One page on the run to share, its verdict first: `palpate report`; raises UserError."""
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
    """Return a run that was made before, from its folder; raises LogError where it is not a run folder."""
    place = Path(folder)
    return FinishedRun(place, RunFolder(place).result)
