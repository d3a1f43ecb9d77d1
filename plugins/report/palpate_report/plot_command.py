"""``palpate plot``: pictures of a run, fit for a paper, with the numbers that they are drawn from."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any

import typer
from palpate import ConfigurationError, Floats, LogError, OutputError, suggest
from palpate_engine import write_whole
from palpate_kit.curves.fit_folder import FitFolder, is_fit_folder
from palpate_kit.figures import FORMATS, WIDTHS, save_figure
from palpate_kit.terminal.options import UnitOption, WhereOption

from palpate_report.run_contents import RunContents

_WIDTHS = {f"{width:g}": width for width in WIDTHS.values()}


def plot(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder, or a folder of fits of many curves.")],
    what: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[PICTURE]...", help="force-depth, time, residuals, estimates, innovations, map. [default: all]"
        ),
    ] = None,
    track: Annotated[
        list[str] | None, typer.Option(help="Tracks to draw, the main one first. [default: all usable]")
    ] = None,
    by: Annotated[
        str | None, typer.Option(metavar="COLUMN", help="Groups of curves by a column of curves.csv, such as sample.")
    ] = None,
    parameter: Annotated[str, typer.Option(help="Parameter of curves.")] = "elasticity",
    unit: UnitOption = None,
    where: WhereOption = None,
    width: Annotated[str, typer.Option(help="Width of the picture [mm]: 85, 120 or 175, or a column's name.")] = "85",
    format: Annotated[list[str] | None, typer.Option("--format", help="png, svg or pdf; can be repeated.")] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder to write to. [default: RUN/pictures]")] = None,
) -> None:
    """Draw pictures of a run, or of groups of curves, as PDF, SVG or PNG in widths of journals.

    Each has a CSV of its numbers next to it.
    """
    endings, millimetres = _formats(format or ["pdf"]), _width(width)
    pictures, tracks = what or [], track or []
    if is_fit_folder(run):
        if pictures or len(tracks) > 1:
            raise ConfigurationError(f"{run}: of a folder of fits its groups are drawn, of one track")
        _draw_groups(run, by, parameter, unit, where, next(iter(tracks), None), endings, millimetres, out)
        return
    # Options for groups mean nothing for a run.
    for option, value in (("--by", by), ("--unit", unit), ("--where", where)):
        if value is not None:
            raise ConfigurationError(f"{option} {value}: {run} is not a folder of fits of many curves")
    record = RunContents.read(run)
    if record.unreadable is not None:
        raise LogError(record.unreadable)
    _draw_run(run, record, pictures, tracks, endings, millimetres, out or record.path / "pictures")


def _draw_run(
    run: Path, record: RunContents, names: Sequence[str], tracks: Sequence[str],
    endings: list[str], width: float, folder: Path,
) -> None:  # fmt: skip
    """Draw pictures of a run into a folder, by default all that it has.

    Each is `width` [mm] wide, and written once with each of the `endings` (".png", ...). Raises ConfigurationError for
    a picture or track that the run does not have.
    """
    from palpate_report.figure_subject import Subject
    from palpate_report.run_figures import PICTURES, draw
    from palpate_report.run_report import subject_of
    from palpate_report.run_verdict import judge

    # Names of pictures and tracks that the run can have.
    for name in names:
        if name not in PICTURES:
            raise ConfigurationError(f"{name!r} is not a picture{suggest(name, PICTURES)}")
    for name in tracks:
        if name not in record.tracks:
            raise ConfigurationError(f"{run}: has no estimates of {name!r}{suggest(name, record.tracks)}")
    shown_tracks = list(tracks) or list(subject_of(record, judge(record)).tracks)
    subject = Subject(record, next(iter(shown_tracks), None), shown_tracks, width)
    # A picture without anything to show is left out, unless its name was given.
    drawn = 0
    for name in names or PICTURES:
        picture = draw(name, subject)
        if picture is not None:
            _write(picture.figure, picture.caption, _csv(picture.data), folder / name, endings)
            drawn += 1
        elif names:
            reason = _MISSING.get(name, "no estimates")
            raise ConfigurationError(f"{run}: has nothing to draw for {name!r}: {reason}")
    if not drawn:
        raise ConfigurationError(f"{run}: has nothing to draw: no estimate was made")


def _draw_groups(
    path: Path, by: str | None, parameter: str, unit: str | None, where: str | None, track: str | None,
    endings: list[str], width: float, out: Path | None,
) -> None:  # fmt: skip
    """Draw the groups of a folder of fits; raises UserError."""
    from palpate_report.groups_figure import folder_comparison, groups_figure

    comparison = folder_comparison(path, by, parameter, unit, where, track)
    picture = groups_figure(comparison, parameter, FitFolder(path).units.get(parameter, ""), width)
    _write(picture.figure, picture.caption, picture.data, (out or path / "pictures") / f"{parameter}-groups", endings)


def _write(figure: Any, caption: str, data: str, path: Path, endings: list[str]) -> None:
    """Write a picture in its formats, and its numbers next to it."""
    _make(path.parent)
    files = [path.with_name(f"{path.name}.{ending}") for ending in endings]
    write_whole(path.with_name(f"{path.name}.csv"), data)
    for file in files:
        save_figure(figure, file)
    typer.echo(f"{', '.join(map(str, files))}: {caption}")


_MISSING = {
    "map": "it is of one place",
    "innovations": "its estimators report none",
    "force-depth": "no estimate was made, or the run dates from before forces were in estimates.csv: replay it",
    "time": "no force was recorded, or the run dates from before forces were in estimates.csv: replay it",
    "residuals": "no estimate was made, or the run dates from before forces were in estimates.csv: replay it",
}


def _make(folder: Path) -> None:
    """Make the folder of the pictures; raises OutputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot make the output folder: {error.strerror}") from error


def _formats(endings: list[str]) -> list[str]:
    """Return each format once; raises ConfigurationError for one that cannot be drawn."""
    for ending in endings:
        if ending not in FORMATS:
            raise ConfigurationError(f"--format {ending}: allowed is {', '.join(FORMATS)}{suggest(ending, FORMATS)}")
    return list(dict.fromkeys(endings))


def _width(text: str) -> float:
    """Return a width [mm] from its number or the name of a column; raises ConfigurationError."""
    width = WIDTHS.get(text, _WIDTHS.get(text.removesuffix("mm").strip()))
    if width is None:
        raise ConfigurationError(f"--width {text}: allowed is {', '.join(_WIDTHS)} mm, or {', '.join(WIDTHS)}")
    return width


def _csv(data: Mapping[str, Floats]) -> str:
    """Return columns side by side [SI], a shorter one with empty cells at its end."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(data)
    columns = [values.tolist() for values in data.values()]
    for cells in zip_longest(*columns, fillvalue=math.nan):
        writer.writerow("" if math.isnan(cell) else f"{cell:.9g}" for cell in cells)
    return file.getvalue()
