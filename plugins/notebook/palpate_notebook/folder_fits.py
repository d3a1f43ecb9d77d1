"""Fits of folders of curves from Python: the results of `palpate fit FOLDER --tip` as a table of pandas."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, redirect_stdout, suppress
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import typer
from palpate import ConfigurationError
from palpate_engine import analysis, display_unit
from palpate_kit.curves.curve_row import CurveRow
from palpate_kit.curves.fit_folder import FitFolder, is_fit_folder

from palpate_notebook.argument_names import explains_arguments
from palpate_notebook.optional_imports import library

if TYPE_CHECKING:
    import pandas

    from palpate_notebook.fitter_object import Rig

_VALUE_SUFFIXES = ("", "_std", "_combined")  # columns of each value in fits.csv
_OTHER_UNITS = {"rms": "N", "x": "m", "y": "m"}  # of columns that are not values
_TEXT_COLUMNS = ("verdict", "conditions", "needs", "flags", "error")


@explains_arguments
def fit_folder(
    path: str | Path | Sequence[str | Path],
    *,
    tip: str | None = None,
    model: str | None = None,
    rig: Rig = None,
    settings: Sequence[str] = (),
    out: str | Path | None = None,
    jobs: int = 1,
    si: bool = True,
) -> pandas.DataFrame:
    """Fit every curve of a folder, of several, or of a folder of fits; return a row for each curve and track.

    The arguments are those of `palpate fit`: `tip` as in "sphere 3 mm", `model` by name or initials, `rig` a file of
    facts or its keys, `settings` as of ``--set``. The columns are those of ``fits.csv``, `used`, and those of
    ``curves.csv``; their units are in ``frame.attrs["units"]`` by column, SI or the units that are shown (`si`). The
    folder of fits is kept where `out` names it. More `jobs` are processes: a script then needs its main guard.

    Raises ConfigurationError for what does not fit together, LogError where no file can be read, OutputError.
    """
    sources = [Path(path)] if isinstance(path, str | Path) else [Path(source) for source in path]
    output: dict[str, Any] = {}  # the argument `out` of the command
    with ExitStack() as stack:
        # A folder of fits is fitted in place, curves into the folder `out` or a temporary one.
        if len(sources) == 1 and is_fit_folder(sources[0]):
            if out is not None:
                raise ConfigurationError(f"{sources[0]}: is a folder of fits, and is fitted where it is: without out=")
            folder = sources[0]
        else:
            folder = Path(out if out is not None else stack.enter_context(TemporaryDirectory(prefix="palpate-")))
            output = {"out": folder}
        overrides = [*settings, *_fact_assignments(rig)]
        with redirect_stdout(StringIO()), suppress(typer.Exit):  # it exits for curves without a value: rows, too
            analysis("fit")(sources, tip=tip, model=model, overrides=overrides or None, jobs=jobs, **output)
        return folder_frame(FitFolder(folder), si)


def _fact_assignments(rig: Rig) -> list[str]:
    """Return the facts of the rig as ``--set``."""
    if rig is None:
        return []
    if isinstance(rig, Mapping):
        return [f"rig.{key}={json.dumps(value)}" for key, value in rig.items()]
    return [f"run.rig={json.dumps(str(Path(rig).absolute()))}"]


def folder_frame(folder: FitFolder, si: bool = True) -> pandas.DataFrame:
    """Return the rows of a folder of fits; the units of the columns are in ``attrs["units"]``, SI or display units."""
    si_units = {}
    for name in folder.values:
        for suffix in _VALUE_SUFFIXES:
            si_units[f"{name}{suffix}"] = folder.units.get(name, "1")
    si_units |= _OTHER_UNITS
    # By column: unit, and factor from SI to it.
    units = {column: (unit, 1.0) if si else display_unit(unit) for column, unit in si_units.items()}
    rows = [_row(row, units, folder.columns) for row in folder.rows]
    columns = ["curve", "track", *folder.columns, *units, "samples", *_TEXT_COLUMNS, "used"]
    frame: pandas.DataFrame = library("pandas").DataFrame(rows, columns=columns).set_index("curve")
    frame.attrs["units"] = {column: unit for column, (unit, _) in units.items()}
    return frame


def _row(curve: CurveRow, units: Mapping[str, tuple[str, float]], group_columns: Sequence[str]) -> dict[str, Any]:
    """Return the row of a curve by column: groups of ``curves.csv``, numbers in their units, texts, and its use."""
    row: dict[str, Any] = {"curve": curve.curve, "track": curve.track}
    for column in group_columns:
        row[column] = curve.groups.get(column, "")
    for column, (_, factor) in units.items():
        number = curve.number(column)
        row[column] = math.nan if number is None else factor * number
    samples = curve.number("samples")
    row["samples"] = 0 if samples is None else int(samples)
    for column in _TEXT_COLUMNS:
        row[column] = curve.cells.get(column, "")
    row["verdict"] = curve.verdict
    row["used"] = curve.usable
    return row
