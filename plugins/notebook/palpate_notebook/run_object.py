"""A finished run: its results as tables, numbers, arrays and pictures."""

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
    """Finished run; `run["dr/ekf"]` is one of its tracks."""

    @property
    def flags(self) -> dict[str, tuple[Flag, ...]]:
        """The flags on each track, by its name."""
        return {name: read_flags(track["flags"]) for name, track in self.document["tracks"].items()}

    def summary(self, si: bool = False) -> pandas.DataFrame:
        """Return a row for each track and parameter: value, std, combined, unit, verdict; in display units, or SI."""
        from palpate_notebook.data_frames import summary_frame

        return summary_frame(self.document, si)

    @property
    def plot(self) -> Plots:
        """The pictures: ``run.plot()``, ``run.plot.force_depth()``, ``run.plot.force()``."""
        return Plots(self)

    def map(
        self,
        track: str | None = None,
        parameter: str | None = None,
        cell: str | float = "1 mm",
        method: Literal["gaussian-process", "average"] = "gaussian-process",
    ) -> MapView:
        """Return the map of a parameter over the places of the run, or its curve along a line.

        The default is the first parameter of the best track. Raises LogError for too few places.
        """
        from palpate_notebook.map_object import map_of

        return map_of(self, track, parameter, cell, method)

    def report(self, path: str | Path = "report.html") -> Path:
        """Write a page on the run to share, like `palpate report`, and return its path; raises UserError."""
        page = Path(path)
        with redirect_stdout(StringIO()):  # the command prints the path
            analysis("report")([self.folder], out=page)
        return page

    def save(self, folder: str | Path) -> Path:
        """Copy all files of the run to a new folder, and return it; raises OutputError for one that exists."""
        target = Path(folder)
        try:
            shutil.copytree(self.folder, target)
        except FileExistsError as error:
            raise OutputError(f"{target}: exists already, and nothing is ever overwritten") from error
        except OSError as error:
            raise OutputError(f"{target}: cannot write: {error.strerror or error}") from error
        return target

    def __repr__(self) -> str:
        return run_text(self.document)

    def _repr_html_(self) -> str:
        return run_html(self.document)


def open_run(folder: str | Path) -> FinishedRun:
    """Return the run of a run folder; raises LogError where it is not one."""
    path = Path(folder)
    return FinishedRun(path, RunFolder(path).result)
