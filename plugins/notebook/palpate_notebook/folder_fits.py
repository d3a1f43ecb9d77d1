"""Folders of curves fitted from Python: what `palpate fit FOLDER --tip` writes, as a table of pandas."""

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

_KINDS = ("", "_std", "_combined")
_OTHERS = {"rms": "N", "x": "m", "y": "m"}  # numbers of a row that are not values, with their units
_TEXTS = ("verdict", "conditions", "needs", "flags", "error")


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
    """Fit every curve of a folder, of several, or of a folder of fits; a row for each curve and track.

    What `palpate fit` does with the same words: `tip` as in "sphere 3 mm", `model` by name or initials, `rig` a file of
    facts or its keys, `settings` as of ``--set``. The columns are those of ``fits.csv``, `used`, and those of
    ``curves.csv``; their units are in ``frame.attrs["units"]`` by column, SI or the units that are shown (`si`). The
    folder of fits is kept where `out` names it. More `jobs` are processes: a script then needs its main guard.

    Raises ConfigurationError for what does not fit together, LogError where no file can be read, OutputError.
    """
    sources = [Path(one) for one in ([path] if isinstance(path, str | Path) else path)]
    with ExitStack() as stack:
        if len(sources) == 1 and is_fit_folder(sources[0]):
            if out is not None:
                raise ConfigurationError(f"{sources[0]}: is a folder of fits, and is fitted where it is: without out=")
            folder = sources[0]
            given: dict[str, Any] = {}
        else:
            place = out if out is not None else stack.enter_context(TemporaryDirectory(prefix="palpate-"))
            folder = Path(place)
            given = {"out": folder}
        overrides = [*settings, *_facts(rig)]
        with redirect_stdout(StringIO()), suppress(typer.Exit):  # of curves without a value, which are rows, too
            analysis("fit")(sources, tip=tip, model=model, overrides=overrides or None, jobs=jobs, **given)
        return folder_frame(FitFolder(folder), si)


def _facts(rig: Rig) -> list[str]:
    if rig is None:
        return []
    if isinstance(rig, Mapping):
        return [f"rig.{key}={json.dumps(value)}" for key, value in rig.items()]
    return [f"run.rig={json.dumps(str(Path(rig).absolute()))}"]


def folder_frame(folder: FitFolder, si: bool = True) -> pandas.DataFrame:
    """Return the rows of a folder of fits; the units of its columns are in ``attrs["units"]``."""
    known = {name: folder.units.get(name, "1") for name in folder.values}
    by_column = {f"{name}{kind}": unit for name, unit in known.items() for kind in _KINDS} | _OTHERS
    shown = {column: (unit, 1.0) if si else display_unit(unit) for column, unit in by_column.items()}
    rows = [_row(row, shown, folder.columns) for row in folder.rows]
    columns = ["curve", "track", *folder.columns, *shown, "samples", *_TEXTS, "used"]
    frame: pandas.DataFrame = library("pandas").DataFrame(rows, columns=columns).set_index("curve")
    frame.attrs["units"] = {column: unit for column, (unit, _) in shown.items()}
    return frame


def _row(row: CurveRow, shown: Mapping[str, tuple[str, float]], groups: Sequence[str]) -> dict[str, Any]:
    numbers = {
        column: math.nan if (number := row.number(column)) is None else factor * number
        for column, (_, factor) in shown.items()
    }
    told = {name: row.cells.get(name, "") for name in _TEXTS}
    samples = row.number("samples")
    return {
        "curve": row.curve, "track": row.track, **{name: row.groups.get(name, "") for name in groups}, **numbers,
        "samples": 0 if samples is None else int(samples), **told, "verdict": row.verdict, "used": row.usable,
    }  # fmt: skip
