"""``palpate compare``: every model with every estimator on one log, in one table and one picture."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from palpate import registry as registries
from palpate.cli.curves import Points, tell_runs
from palpate.cli.log_info import pipeline_text, recording_of
from palpate.cli.tables import result_view
from palpate.config import Pipeline, Source, build_pipeline
from palpate.errors import ConfigurationError
from palpate.units import people

if TYPE_CHECKING:
    from rich.console import RenderableType

    from palpate.pipeline import Result


def compare(
    log: Annotated[Path, typer.Argument(help="A log (.mcap, .db3, a bag folder, .csv), or a pipeline file (.toml).")],
    models: Annotated[str | None, typer.Option(help="Contact models by type, with commas between.")] = None,
    estimators: Annotated[str | None, typer.Option(help="Estimators by type, with commas between.")] = None,
    reference: Annotated[str | None, typer.Option(metavar="TRACK", help="Show this track as the truth.")] = None,
    out: Annotated[Path | None, typer.Option(help="Run folder; must be new or empty.")] = None,
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="TABLE.KEY=VALUE", help="Override a setting; can be repeated.")
    ] = None,
    time: Annotated[str | None, typer.Option(metavar="COLUMN", help="What is the time in a CSV file.")] = None,
    rate: Annotated[str | None, typer.Option(help="Rate of a CSV file without a time, such as '500 Hz'.")] = None,
    points: Points = None,
) -> None:
    """Run every model with every estimator on one log, read once; print one table, draw one picture.

    Of a sweep along a line, the curves are drawn, too, with the lumps in each.
    """
    from rich.console import Console

    from palpate.pipeline import run_pipeline

    choices = {role: text for role, text in (("time", time), ("rate", rate)) if text is not None}
    pipeline = _pipeline(_source(log, choices), models, estimators, overrides or [])
    names = [track.name for track in pipeline.tracks]
    if reference is not None and reference not in names:
        raise ConfigurationError(f"--reference: there is no track {reference!r} (there are: {', '.join(names)})")
    result = run_pipeline(pipeline, out)
    console = Console()
    console = console if console.is_terminal else Console(width=120)
    console.print(result_view(result))
    if reference is not None:
        console.print(_differences(result, reference))
    picture = _draw(result, reference)
    typer.echo(f"picture: {picture}" if picture else "no picture: it needs matplotlib (pip install matplotlib)")
    _along(pipeline, result, points)


def _along(pipeline: Pipeline, result: Result, points: Path | None) -> None:
    """Curves of a sweep along a line; nothing where it was none."""
    aligned = pipeline.alignment
    if points is not None or aligned.lateral_x is not None or aligned.lateral_y is not None:
        tell_runs({"": result.folder}, result.folder, points, needed=points is not None)


def _source(log: Path, choices: Mapping[str, str]) -> Source:
    """A pipeline file, or what is suggested for a log."""
    if log.suffix == ".toml":
        return Source.read(log)
    suggestion = recording_of(log).suggest(log, choices)
    return Source(pipeline_text(suggestion, log), Path(f"{log.name}.toml"))


def _pipeline(source: Source, models: str | None, estimators: str | None, overrides: list[str]) -> Pipeline:
    for kind, given in (("model", models), ("estimator", estimators)):
        if given is not None:
            source.tables[kind] = {name: _table(kind, name, source.tables) for name in _names(given)}
    for assignment in overrides:
        source.override(assignment)
    return build_pipeline(source)


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _table(kind: str, name: str, tables: Mapping[str, Any]) -> dict[str, Any]:
    """The table of that name, or one of that type with its defaults, on the pipeline's indenter."""
    known = tables.get(kind, {})
    if isinstance(known, dict) and name in known:
        return dict(known[name])
    entry = registries.load().parts[kind].get(name)
    table: dict[str, Any] = {"type": name}
    indenters = tables.get("indenter", {})
    if entry is not None and "indenter" in entry.part.model_fields and indenters:
        table["indenter"] = next(iter(indenters))
    return table


def _differences(result: Result, reference: str) -> RenderableType:
    """Every track's parameters against those of the reference, in per cent and in their joint standard deviations."""
    from rich.table import Table

    table = Table(title=f"against {reference}", title_justify="left")
    table.add_column("track")
    truth = result.tracks[reference].parameters
    for name in truth:
        table.add_column(f"{name}\n%", justify="right")
        table.add_column("sigma\n", justify="right")
    for label, track in result.tracks.items():
        if label == reference:
            continue
        cells = []
        for name, true in truth.items():
            found = track.parameters.get(name)
            difference = math.nan if found is None else found.value - true.value
            spread = math.nan if found is None else math.hypot(found.combined, true.combined)
            cells += [_cell(100.0 * difference, true.value), _cell(difference, spread)]
        table.add_row(label, *cells)
    return table


def _cell(value: float, scale: float) -> str:
    return f"{value / scale:+.2f}" if scale and math.isfinite(value) and math.isfinite(scale) else "-"


def _draw(result: Result, reference: str | None) -> Path | None:
    """Parameters over time with bands of two standard deviations, from both tables; None without matplotlib."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return None
    columns = _curves(result.folder)
    parameters = list(dict.fromkeys(p for track in result.tracks.values() for p in track.parameters if p != "surface"))
    figure = Figure(figsize=(9.0, 3.0 * max(len(parameters), 1)), layout="constrained")
    for axes, parameter in zip(np.atleast_1d(figure.subplots(len(parameters), sharex=True)), parameters, strict=True):
        _draw_parameter(axes, columns, parameter, result, reference)
    path = result.folder / "compare.png"
    figure.savefig(path, dpi=120)
    return path


def _curves(folder: Path) -> dict[str, Any]:
    """Columns of both tables of estimates by their names, each track's time under ``TRACK:time``."""
    curves: dict[str, Any] = {}
    for path in (folder / "estimates.csv", folder / "estimates-offline.csv"):
        if not path.is_file():
            continue
        with path.open(newline="", encoding="utf-8") as file:
            header, *rows = csv.reader(file)
        table = np.array([[float(cell or "nan") for cell in row] for row in rows]).reshape(-1, len(header)).T
        found = dict(zip(header, table, strict=True))
        labels = {name.split(":")[0] for name in header if ":" in name}
        curves |= found | {f"{label}:time": found["time_s"] for label in labels}
    return curves


def _draw_parameter(
    axes: Any, columns: Mapping[str, Any], parameter: str, result: Result, reference: str | None
) -> None:
    units = {name: found.unit for track in result.tracks.values() for name, found in track.parameters.items()}
    unit, factor = people(units.get(parameter, ""))
    settled: list[Any] = []
    for label in result.tracks:
        value, std = columns.get(f"{label}:{parameter}"), columns.get(f"{label}:{parameter}_std")
        if value is None or std is None:
            continue
        time, value, std = columns[f"{label}:time"], value * factor, std * factor
        style = {"color": "black", "linewidth": 2.0} if label == reference else {"linewidth": 1.0}
        name = f"{label} (reference)" if label == reference else label
        (line,) = axes.plot(time, value, label=name, **style)
        axes.fill_between(time, value - 2 * std, value + 2 * std, color=line.get_color(), alpha=0.2, linewidth=0)
        known = value[np.isfinite(value)]
        settled += [known[len(known) // 2 :]]
    if sum(map(len, settled)):  # the wide bands of the first moments would hide everything else
        low, high = np.concatenate(settled).min(), np.concatenate(settled).max()
        margin = max(high - low, 0.25 * max(abs(low), abs(high)))
        axes.set_ylim(low - margin, high + margin)
    axes.set_ylabel(f"{parameter} [{unit}]")
    axes.set_xlabel("time [s]")
    axes.grid(alpha=0.3)
    axes.legend()
