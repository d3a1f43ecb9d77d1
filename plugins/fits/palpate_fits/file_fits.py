"""Fits of files without a pipeline: one table with a verdict for each, and the pipeline that was used."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import typer
from palpate import ConfigurationError, printable
from palpate.host import Pipeline, Registry, approved_plugins, display_unit, make_folder, registry, verdict_word
from palpate_kit.curves.alike_logs import logs_among
from palpate_kit.curves.curve_fits import CurveReader, Row, value_units
from palpate_kit.curves.curve_table import SETTINGS, TABLE, FitTable
from palpate_kit.curves.folder_fits import FEW, fit_each
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.progress import progress, report_progress
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table, console

from palpate_fits.file_pipelines import DEVICE, FileGroup, file_groups

_WIDTH = 80  # columns
_NAME = 28  # characters of a file's name
_SHOWN = ("elasticity", "viscosity")
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


def fit_files(sources: Sequence[Path], wanted: FileFit) -> None:
    """Fit files that bring no pipeline, and print what was found of each; exit 1 where one was not usable."""
    refused: dict[str, str] = {}
    with progress("look at the files"):
        known = registry.load()
        files = logs_among(sources, known)
        groups = list(file_groups(files, wanted.tip, wanted.model, wanted.choices, wanted.overrides, refused))
    if not groups:
        name, error = next(iter(refused.items()))
        others = f" ({len(refused) - 1} more files cannot be read either)" if len(refused) > 1 else ""
        raise ConfigurationError(f"{name}: {error}{others}")
    folder = wanted.out or make_folder("fit", None, datetime.now(UTC).astimezone())
    order = {str(file): place for place, file in enumerate(files)}
    rows = [row for row in _fitted(groups, folder, wanted, len(files)) if row["curve"] in order]
    if not wanted.fitting:
        for name, error in refused.items():
            typer.echo(f"{name}: {error}", err=True)
        typer.echo(f"{sum(len(group.curves) for group in groups)} curves to fit: palpate fit {folder}")
        return
    rows += [{"curve": name, "error": error} for name, error in refused.items()]
    rows.sort(key=lambda row: order[row["curve"]])
    bad = [row for row in rows if not _usable(row)]
    if wanted.as_json:
        print_json({"table": str(folder / TABLE), "files": rows})
    else:
        _show(rows, bad, groups, folder, known, wanted.overrides)
    if bad:
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


def _usable(row: Row) -> bool:
    return not row.get("error") and row.get("verdict") != "invalid"


def _show(
    rows: Sequence[Row],
    bad: Sequence[Row],
    groups: Sequence[FileGroup],
    folder: Path,
    known: Registry,
    overrides: Sequence[str],
) -> None:
    console(_WIDTH).print(overview(rows, groups[0].pipeline).view())
    for row in bad:
        if row.get("error"):
            typer.echo(f"{row['curve']}: {row['error']}", err=True)
    _show_guesses(groups)
    doubtful = [row for row in rows if row.get("verdict") == "doubtful"]
    if doubtful:
        typer.echo(f"doubtful: {_causes(doubtful, known, 'doubtful')}; palpate describe CODE says what to do")
    if any("delay-unclear" in row.get("flags", "").split() for row in doubtful):
        typer.echo(_timing(overrides))
    typer.echo(f"{folder / TABLE}: every number; {SETTINGS} beside it: how the files were read")
    first = next((row["curve"] for row in rows if _usable(row)), None)
    if first is not None:
        page = folder / "page"
        made = f"palpate fit {first} --pipeline {folder / SETTINGS} -o {page}"
        typer.echo(f"a page on one: {made} && palpate report {page / Path(first).name.split('.')[0]}")
    usable = len(rows) - len(bad)
    typer.echo(f"{usable} usable, {len(bad)} not: {_causes(bad, known, 'invalid')}" if bad else f"all {usable} usable")


def _timing(overrides: Sequence[str]) -> str:
    """What is still to be stated of the timing."""
    stated = {
        role for role in ("force", "position") if any(text.startswith(f"alignment.{role}.") for text in overrides)
    }
    if "force" not in stated:
        return 'timing: state it by --set alignment.force.uncertainty="1 ms", or by its delay'
    if "position" not in stated:
        return (
            "timing: a position without noise may be the command, which an arm follows later; if it was measured: "
            '--set alignment.position.uncertainty="1 ms"'
        )
    return "timing: what is stated of it leaves the viscosity open"


def _show_guesses(groups: Sequence[FileGroup]) -> None:
    """What no file states, for the first groups of files."""
    guesses = [doubt for group in groups for doubt in group.doubts]
    for doubt in guesses[:_GUESSES]:
        typer.echo(f"check {printable(doubt)}", err=True)
    if len(guesses) > _GUESSES:
        typer.echo(f"{len(guesses) - _GUESSES} more guesses: palpate info FILE --suggest", err=True)


def overview(rows: Sequence[Row], pipeline: Pipeline) -> Table:
    """File, values with combined uncertainty in display units, and verdict."""
    units = value_units(pipeline.tracks[0].model)
    shown = [name for name in _SHOWN if name in units] or list(units)[:2]
    heads = [f"{name}\n{display_unit(units[name])[0]}" for name in shown]
    cells = [
        [
            _short(row["curve"]),
            *(_cell(row, name, units[name]) for name in shown),
            verdict_word(row.get("verdict") or "not read"),
        ]
        for row in rows
    ]
    return Table.of("", ["file", *heads, "verdict"], cells, ["file", "verdict"])


def _cell(row: Mapping[str, Any], name: str, unit: str) -> str:
    if not row.get(name):
        return "-"
    factor = display_unit(unit)[1]
    combined = row.get(f"{name}_combined")
    value = float(row[name]) * factor
    return value_with_uncertainty(value, float(combined) * factor) if combined else f"{value:.4g} ± ?"


def _short(name: str) -> str:
    return name if len(name) <= _NAME else f"...{name[3 - _NAME :]}"


def _causes(rows: Sequence[Row], known: Registry, severity: str) -> str:
    """How many have which flags of a severity, the most frequent first."""
    causes: Counter[str] = Counter()
    for row in rows:
        meanings = {code: known.meanings.get(code) for code in row.get("flags", "").split()}
        codes = [code for code, meaning in meanings.items() if meaning is not None and meaning.severity == severity]
        causes.update(codes or ["not read" if row.get("error") else "no value"])
    return ", ".join(f"{cause} ({count})" for cause, count in causes.most_common())
