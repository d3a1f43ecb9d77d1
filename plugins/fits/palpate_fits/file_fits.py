"""Fits of files without a pipeline: one table with a verdict for each, and the pipeline that was used."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import typer
from palpate import ConfigurationError, printable
from palpate_engine import Registry, approved_plugins, make_folder, registry
from palpate_kit.curves.alike_logs import LogPart, logs_among, specimens_of
from palpate_kit.curves.curve_fits import CurveReader, Row
from palpate_kit.curves.curve_table import SETTINGS, TABLE, FitTable
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.progress import progress, report_progress

from palpate_fits.file_pipelines import DEVICE, FileGroup, file_groups
from palpate_fits.file_tables import count_line, is_usable, show_rows
from palpate_fits.folder_fits import FEW, fit_each

_GUESSES = 6  # that are printed


@dataclass(frozen=True)
class FileFit:
    """What is asked of files that bring no pipeline."""

    tip: str
    model: str
    choices: Mapping[str, str]  # columns by role
    overrides: tuple[str, ...]
    out: Path | None
    jobs: int | None
    as_json: bool
    fitting: bool = True
    details: bool = False


def fit_files(sources: Sequence[Path], wanted: FileFit) -> None:
    """Fit files that bring no pipeline, and print what was found of each; exit 1 where one was not usable."""
    refused: dict[str, str] = {}
    notes: list[str] = []
    with progress("look at the files"):
        known = registry.load()
        chosen = tuple(f"device.{DEVICE}.{key}" for key in ("sheet", "header"))
        one = any(text.strip().startswith(chosen) for text in wanted.overrides)
        logs = logs_among(sources, known)
        files = [part for log in logs for part in ([LogPart(log)] if one else specimens_of(log))]
        groups = list(file_groups(files, wanted.tip, wanted.model, wanted.choices, wanted.overrides, refused, notes))
    for note in notes:
        typer.echo(note, err=True)
    if not groups:
        name, error = next(iter(refused.items()))
        others = f" ({len(refused) - 1} more files cannot be read either)" if len(refused) > 1 else ""
        raise ConfigurationError(f"{name}: {error}{others}")
    folder = wanted.out or make_folder("fit", None, datetime.now(UTC).astimezone())
    order = {str(file): place for place, file in enumerate(files)}
    paths = {str(file): str(file.path) for file in files}
    rows = [row for row in _fitted(groups, folder, wanted, len(files)) if row["curve"] in order]
    if not wanted.fitting:
        for name, error in refused.items():
            typer.echo(f"{name}: {error}", err=True)
        typer.echo(f"{sum(len(group.curves) for group in groups)} curves to fit: palpate fit {folder}")
        return
    rows += [{"curve": name, "error": error} for name, error in refused.items()]
    rows.sort(key=lambda row: order[row["curve"]])
    if wanted.as_json:
        print_json({"table": str(folder / TABLE), "files": rows})
    else:
        _show(rows, groups, paths, folder, known, wanted)
    if not all(map(is_usable, rows)):
        raise typer.Exit(1)


def _fitted(groups: Sequence[FileGroup], folder: Path, wanted: FileFit, count: int) -> list[Row]:
    """The rows of the table, those of every group that had none yet added."""
    table: FitTable | None = None
    with progress("fit", "files", count):
        done = 0
        for number, group in enumerate(groups, start=1):
            settings = SETTINGS if number == 1 else f"pipeline-{number}.toml"
            reader = CurveReader(group.text, str(group.path), wanted.overrides, DEVICE, approved_plugins())
            workers = wanted.jobs or (1 if len(group.curves) < FEW else None)
            table = fit_each(group.pipeline, reader, group.curves, folder, workers, settings, wanted.fitting)
            done += len(group.curves)
            report_progress(done)
    assert table is not None
    return table.rows


def _show(
    rows: Sequence[Row],
    groups: Sequence[FileGroup],
    paths: Mapping[str, str],
    folder: Path,
    known: Registry,
    wanted: FileFit,
) -> None:
    show_rows(rows, groups[0].pipeline, known, wanted.details)
    _show_guesses(groups, wanted.details)
    typer.echo(f"{folder / TABLE}: every number; {SETTINGS} beside it: how the files were read")
    alike = {curve.name for curve in groups[0].curves}
    first = next((paths[row["curve"]] for row in rows if is_usable(row) and row["curve"] in alike), None)
    if first is not None:
        page = folder / "page"
        words = ["palpate", "fit", _no_option(first), "--pipeline", str(folder / SETTINGS), "-o", str(page)]
        report = shlex.join(["palpate", "report", str(page / Path(first).name.split(".")[0])])
        typer.echo(f"a page on one: {shlex.join(words)} && {report}")
    typer.echo(count_line(rows, known))


def _no_option(name: str) -> str:
    return f"./{name}" if name.startswith("-") else name


def _show_guesses(groups: Sequence[FileGroup], details: bool) -> None:
    """What no file states, for the first groups of files."""
    guesses = [doubt for group in groups for doubt in group.doubts]
    shown = guesses if details else guesses[:_GUESSES]
    for doubt in shown:
        typer.echo(f"check {printable(doubt)}", err=True)
    if more := len(guesses) - len(shown):
        typer.echo(f"{more} more {'guess' if more == 1 else 'guesses'}: --details shows all", err=True)
