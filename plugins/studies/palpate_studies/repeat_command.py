"""``palpate repeat``: statistics over many runs of one palpation."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from palpate import ConfigurationError, to_si
from palpate_engine import finite_tree
from palpate_kit.jobs.engines import SchedulerOption, StageOption
from palpate_kit.numerics.group_comparison import GroupComparison
from palpate_kit.numerics.repeated_values import combined_of_mean, common_part
from palpate_kit.runs.run_groups import groups_of, natural
from palpate_kit.terminal.options import DetailsOption, FormatOption, Overrides, UnitOption, WhereOption
from palpate_kit.terminal.table import console

from palpate_studies.force_error import force_error
from palpate_studies.repeat_figure import draw_repeatability
from palpate_studies.repeat_tables import views
from palpate_studies.repeatability import error_of_mean, repeatability
from palpate_studies.repeated_runs import perform
from palpate_studies.value_group import ValueGroup, compare, groups_by_column, read_groups
from palpate_studies.value_rows import write_value_table


def repeat(
    sources: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="RUN...",
            help="Run folders, folders of them or of fits of many curves, logs of runs, result.json or fit.json files; "
            "or a pipeline file with a [repeat] table, which is run so often.",
        ),
    ] = None,
    group: Annotated[
        list[str] | None, typer.Option(metavar="NAME=PATTERN", help="A group of runs by a pattern; can be repeated.")
    ] = None,
    by: Annotated[
        str | None, typer.Option(metavar="COLUMN", help="Groups of curves by a column of curves.csv, such as sample.")
    ] = None,
    unit: UnitOption = None,
    mixed: Annotated[
        bool,
        typer.Option("--mixed", help="Compare by a mixed model, with a random intercept of each unit (statsmodels)."),
    ] = False,
    where: WhereOption = None,
    track: Annotated[str | None, typer.Option(help="Track, such as dr/fit. [default: the only one]")] = None,
    parameter: Annotated[
        str | None, typer.Option(help="Parameter, or surface. [default: elasticity; of --table all]")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Draw histogram, autocorrelation, moving average and force error here.")
    ] = None,
    truth: Annotated[
        str | None, typer.Option(help='What it is known to be, such as "282.1 kPa": prints the error of each group.')
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write every value of all runs and fits, a row each, to .csv, .parquet or .xlsx."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder of the runs of a pipeline file; must be new or empty.")
    ] = None,
    overrides: Overrides = None,
    scheduler: SchedulerOption = None,
    stage: StageOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as JSON.")] = False,
    details: DetailsOption = False,
    layout: FormatOption = "table",
) -> None:
    """Mean, standard uncertainty, autocorrelation, trend and histogram over many runs; tests between groups.

    Every two groups are compared by Welch's t-test of their units, with Holm's correction for several pairs; three or
    more also by Welch's analysis of variance and Games and Howell's test.
    """
    if table is not None:
        _demand_none({
            "--group": group, "--by": by, "--unit": unit, "--mixed": mixed, "--picture": picture, "--truth": truth,
            "--out": out, "--set": overrides, "--scheduler": scheduler, "--json": as_json,
        })  # fmt: skip
        if write_value_table(table, sources or [], track, parameter, where):
            raise typer.Exit(1)
        return
    parameter = parameter or "elasticity"
    files: dict[str, list[Path]] = {}
    for name, paths in groups_of(sources or [], group or []).items():
        files[name] = [run for path in paths for run in _runs_of(path, overrides or [], out, scheduler, stage)]
    if by is None:
        groups = read_groups(files, track, parameter, where)
    else:
        groups = groups_by_column((path for paths in files.values() for path in paths), by, track, parameter, where)
    document = _document(groups, compare(groups, unit, mixed), parameter, truth)
    if picture is not None:
        draw_repeatability(document, picture)
    _print_document(document, as_json, details)
    failures = {path for members in groups.values() for path in members.failures}
    if failures:
        typer.echo(f"{len(failures)} runs failed", err=True)
        raise typer.Exit(1)


def _demand_none(options: Mapping[str, object]) -> None:
    """Raise ConfigurationError for options of statistics next to ``--table``."""
    option = next((name for name, value in options.items() if value), None)
    if option is not None:
        raise ConfigurationError(f"--table: writes all values and compares nothing; {option} is for statistics")


def _document(
    groups: Mapping[str, ValueGroup], comparison: GroupComparison, parameter: str, truth: str | None
) -> dict[str, Any]:
    """Return statistics, comparison and verdicts of the groups as plain data, None for numbers that are not finite."""
    unit = list(groups.values())[-1].unit
    tables = repeatability({name: group.values for name, group in groups.items()})
    for unit_group in comparison.groups:
        name = unit_group.name
        # The statistics of units go before those of single values, unless each unit is a single value.
        for key, statistic in unit_group.table().items():
            if key not in tables[name] or not comparison.singles:
                tables[name][key] = statistic
        true_value = None if truth is None else _true_value(truth, unit)
        tables[name] |= _group_statistics(groups[name], tables[name], true_value)
    counts = {
        "parameter": parameter,
        "unit": unit,
        "skipped": sum(group.skipped for group in groups.values()),
        "rejected": {run: reason for group in groups.values() for run, reason in group.rejected.items()},
        "verdicts": {name: dict(group.verdicts) for name, group in groups.items()},
    }
    document: dict[str, Any] = finite_tree({**counts, "groups": tables, **comparison.table()})
    return document


def _group_statistics(group: ValueGroup, table: Mapping[str, Any], true_value: float | None) -> dict[str, Any]:
    """Return the statistics of a group that need more than its values, by the mean and its uncertainty in the table.

    They are the common part of the uncertainties, that of the mean with it, the force error, and the error of the mean.
    """
    common = np.array(group.common)
    # Only runs, which have no key, have tables of estimates.
    runs = [(reading.folder, reading.track) for reading in group.readings if reading.key == ""]
    statistics = {
        "common": common_part(common),
        "combined_of_mean": combined_of_mean(table["std_of_mean"], common),
        "force_error": force_error(runs),
    }
    if true_value is not None:
        combined = np.array([reading.std or 0.0 for reading in group.readings])
        statistics["truth"] = error_of_mean(table["mean"], table["std_of_mean"], combined, true_value)
    return statistics


def _print_document(document: dict[str, Any], as_json: bool, details: bool) -> None:
    """Print the document, as tables or as JSON."""
    if as_json:
        typer.echo(json.dumps(document, indent=2))
        return
    terminal = console()
    for view in views(document, details):
        terminal.print(view, highlight=False, markup=False)


def _runs_of(
    path: Path, overrides: list[str], out: Path | None, scheduler: str | None, stage: str | None
) -> list[Path]:
    """Return the runs of a source: those in a folder of runs, or those made of a pipeline file. Raises UserError."""
    if path.suffix == ".toml" and path.is_file():
        return perform(path, overrides, out, scheduler, stage)
    is_result = any((path / name).exists() for name in ("fit.json", "result.json", "fits.csv"))
    if not path.is_dir() or is_result:
        return [path]
    runs = [result.parent for result in path.glob("*/result.json")]
    return sorted(runs, key=natural) or [path]


def _true_value(text: str, unit: str) -> float:
    """Return the value [SI] of a text such as "282.1 kPa"; raises ConfigurationError for another unit, and for 0."""
    try:
        value = to_si(text, unit)
    except ValueError as error:
        raise ConfigurationError(f"--truth: {error}") from error
    if not value:
        raise ConfigurationError("--truth: an error relative to 0 says nothing")
    return value
