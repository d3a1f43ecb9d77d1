"""``palpate repeat``: what many runs of one palpation say together."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from palpate import ConfigurationError, LogError, UserError, suggest, to_si
from palpate_engine import ConsentError, finite_tree
from palpate_kit.curves.fit_folder import FitFolder, is_fit_folder
from palpate_kit.jobs.engines import SchedulerOption, StageOption
from palpate_kit.terminal.options import DetailsOption, FormatOption, Overrides, WhereOption
from palpate_kit.terminal.table import console

from palpate_studies.force_error import force_error
from palpate_studies.log_estimates import LogRuns
from palpate_studies.parameter_values import ParameterValue, natural, readings, tell_left_out
from palpate_studies.repeat_figure import draw_repeatability
from palpate_studies.repeat_tables import views
from palpate_studies.repeatability import against_truth, repeatability, uncertainty_of_mean
from palpate_studies.repeated_runs import perform


@dataclass
class _Group:
    """What the runs of a group say of a parameter."""

    name: str
    unit: str = ""
    values: list[float] = field(default_factory=list)
    stated: list[float] = field(default_factory=list)  # standard uncertainty of each
    common: list[float] = field(default_factory=list)  # part of it that the runs share, of those that tell it
    tracked: list[tuple[Path, str]] = field(default_factory=list)
    skipped: int = 0
    rejected: dict[str, str] = field(default_factory=dict)  # by run: why
    failures: dict[str, UserError] = field(default_factory=dict)  # by path

    def read(self, path: Path, estimated: LogRuns, track: str | None, parameter: str, where: str | None = None) -> None:
        """Take in the readings of a file; one that cannot be read is left out. Raises ConsentError."""
        try:
            of_file = list(readings(estimated.run_of(path), track, parameter, where=where))
        except ConsentError:
            raise
        except UserError as error:
            self.failures[str(path)] = error.with_traceback(None)  # which holds the file's contents
            return
        for reading in of_file:
            self.take(reading)

    def take(self, reading: ParameterValue) -> None:
        """Take in one reading."""
        self.unit = reading.unit
        if reading.rejected is not None:
            self.rejected[reading.name] = reading.rejected
        elif reading.usable and reading.value is not None:
            self.values.append(reading.value)
            self.tracked += [(reading.folder, reading.track)] if reading.key == "" else []
            self.stated.append(reading.std or 0.0)
            self.common += [] if reading.systematic is None else [reading.systematic]
        else:
            self.skipped += 1

    def demand_values(self, parameter: str) -> None:
        """Say which runs are left out; raises what the first failed with, or LogError, where no run has a value."""
        tell_left_out(self.failures, others=bool(self.values))
        if not self.values:
            raise LogError(f"group {self.name}: no run has a value of {parameter}")


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
    where: WhereOption = None,
    track: Annotated[str | None, typer.Option(help="Track, such as dr/fit. [default: the only one]")] = None,
    parameter: Annotated[str, typer.Option(help="Parameter, or surface.")] = "elasticity",
    picture: Annotated[
        Path | None, typer.Option(help="Draw histogram, autocorrelation, moving average and force error here.")
    ] = None,
    truth: Annotated[
        str | None, typer.Option(help='What it is known to be, such as "282.1 kPa": prints the error of each group.')
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

    Between two groups Welch's t-test; of three or more Welch's analysis of variance and Games and Howell's test, too.
    """
    files: dict[str, list[Path]] = {}
    for name, paths in _groups(sources or [], group or []).items():
        files[name] = [run for path in paths for run in _runs(path, overrides or [], out, scheduler, stage)]
    groups = _read(files, track, parameter, where) if by is None else _by_column(files, by, track, parameter, where)
    document = _document(groups, parameter, truth)
    if picture is not None:
        draw_repeatability(document, picture)
    _show(document, as_json, details)
    if failures := dict.fromkeys(path for found in groups.values() for path in found.failures):
        typer.echo(f"{len(failures)} runs failed", err=True)
        raise typer.Exit(1)


def _read(
    files: Mapping[str, Sequence[Path]], track: str | None, parameter: str, where: str | None
) -> dict[str, _Group]:
    """What the files of each group say of a parameter; raises UserError where a group says nothing."""
    estimated = LogRuns()
    groups = {name: _Group(name) for name in files}
    for name, paths in files.items():
        for path in paths:
            groups[name].read(path, estimated, track, parameter, where)
        groups[name].demand_values(parameter)
    return groups


def _by_column(
    files: Mapping[str, Sequence[Path]], by: str, track: str | None, parameter: str, where: str | None
) -> dict[str, _Group]:
    """Curves of folders in groups by a column of curves.csv; raises UserError where a group says nothing."""
    groups: dict[str, _Group] = {}
    for path in (path for paths in files.values() for path in paths):
        if not is_fit_folder(path):
            raise ConfigurationError(f"--by {by}: {path} is no folder of fits of many curves")
        columns = FitFolder(path).columns
        if by not in columns:
            raise ConfigurationError(f"--by {by}: {path / 'curves.csv'} has no such column{suggest(by, columns)}")
        for reading in readings(path, track, parameter, where=where):
            name = reading.groups.get(by) or "none"
            groups.setdefault(name, _Group(name)).take(reading)
    for group in groups.values():
        group.demand_values(parameter)
    if not groups:
        raise ConfigurationError(f"--where {where!r}: holds of no curve")
    return groups


def _document(groups: Mapping[str, _Group], parameter: str, truth: str | None) -> dict[str, Any]:
    """What is found, as JSON can hold it."""
    unit = list(groups.values())[-1].unit
    rejected = {run: reason for group in groups.values() for run, reason in group.rejected.items()}
    skipped = sum(group.skipped for group in groups.values())
    counted = {"parameter": parameter, "unit": unit, "skipped": skipped, "rejected": rejected}
    found = repeatability({name: group.values for name, group in groups.items()})
    document: dict[str, Any] = finite_tree({**counted, **found})
    for name, group in groups.items():
        document["groups"][name] |= finite_tree(uncertainty_of_mean(np.array(group.values), np.array(group.common)))
        document["groups"][name]["force_error"] = finite_tree(force_error(group.tracked))
    if truth is not None:
        known = _truth(truth, unit)
        for name, group in groups.items():
            table = against_truth(np.array(group.values), np.array(group.stated), known)
            document["groups"][name]["truth"] = table
    return document


def _show(document: dict[str, Any], as_json: bool, details: bool) -> None:
    """Print what was found."""
    if as_json:
        typer.echo(json.dumps(document, indent=2))
        return
    terminal = console()
    for view in views(document, details):
        terminal.print(view, highlight=False, markup=False)


def _runs(path: Path, overrides: list[str], out: Path | None, scheduler: str | None, stage: str | None) -> list[Path]:
    """The runs of a source: those in a folder of them, or those made of a pipeline file. Raises UserError."""
    if path.suffix == ".toml" and path.is_file():
        return perform(path, overrides, out, scheduler, stage)
    if path.is_dir() and not any((path / name).exists() for name in ("fit.json", "result.json", "fits.csv")):
        return sorted((inner.parent for inner in path.glob("*/result.json")), key=natural) or [path]
    return [path]


def _truth(text: str, unit: str) -> float:
    """The true value [SI]; raises ConfigurationError."""
    try:
        value = to_si(text, unit)
    except ValueError as error:
        raise ConfigurationError(f"--truth: {error}") from error
    if not value:
        raise ConfigurationError("--truth: an error relative to 0 says nothing")
    return value


def _groups(sources: list[Path], groups: list[str]) -> dict[str, list[Path]]:
    """Files by group, each group in the natural order of its names, so that no order of arguments matters."""
    found: dict[str, list[Path]] = {"runs": list(sources)} if sources else {}
    for text in groups:
        name, equals, pattern = text.partition("=")
        if not equals or not name or not pattern:
            raise ConfigurationError(f'--group {text}: write NAME=PATTERN, such as soft="runs/soft_*"')
        base = Path(pattern).anchor or "."
        relative = str(Path(pattern).relative_to(base)) if Path(pattern).anchor else pattern
        paths = list(Path(base).glob(relative))
        if not paths:
            raise ConfigurationError(f"--group {text}: nothing matches {pattern!r}")
        found[name] = [*found.get(name, []), *paths]
    if not found:
        raise ConfigurationError("name at least one run folder, or a --group NAME=PATTERN")
    return {name: sorted(set(paths), key=natural) for name, paths in found.items()}
