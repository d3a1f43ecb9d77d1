"""``palpate repeat``: what many runs of one palpation say together."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from palpate import ConfigurationError, LogError, UserError, to_si
from palpate.host import FormatOption, Overrides, console, finite_tree, measured, people

from palpate_studies.engines import SchedulerOption
from palpate_studies.estimated import Estimated
from palpate_studies.force_error import force_error
from palpate_studies.readings import natural, readings
from palpate_studies.repeat_picture import draw_repeatability
from palpate_studies.repeatability import against_truth, repeatability
from palpate_studies.repeating import perform

_BAR = 40  # characters of the tallest bar
_CAUTION = (
    "p is the chance of such a difference between repeats at one site each. Sites of one material differ, too: before "
    "a difference is called a lump, compare it with the spread over a dozen baseline sites."
)


@dataclass
class _Group:
    """What the runs of a group say of a parameter."""

    name: str
    unit: str = ""
    values: list[float] = field(default_factory=list)
    stated: list[float] = field(default_factory=list)  # standard uncertainty of each
    tracked: list[tuple[Path, str]] = field(default_factory=list)
    skipped: int = 0
    rejected: dict[str, str] = field(default_factory=dict)  # by run: why
    failures: dict[str, UserError] = field(default_factory=dict)  # by path

    def read(self, path: Path, estimated: Estimated, track: str | None, parameter: str) -> None:
        """Take in the readings of a file; one that cannot be read is told and left out."""
        try:
            of_file = list(readings(estimated.run_of(path), track, parameter))
        except UserError as error:
            self.failures[str(path)] = error
            typer.echo(f"{path} is left out: {error}", err=True)
            return
        for reading in of_file:
            self.unit = reading.unit
            if reading.rejected is not None:
                self.rejected[reading.name] = reading.rejected
            elif reading.usable and reading.value is not None:
                self.values.append(reading.value)
                self.tracked += [(reading.folder, reading.track)] if reading.key == "" else []
                self.stated.append(reading.std or 0.0)
            else:
                self.skipped += 1

    def demand_values(self, parameter: str) -> None:
        """Raise what the first run failed with, or LogError, where no run has a value."""
        if not self.values and self.failures:
            raise next(iter(self.failures.values()))
        if not self.values:
            raise LogError(f"group {self.name}: no run has a value of {parameter}")


def repeat(
    sources: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="RUN...",
            help="Run folders, folders of them, logs of runs, result.json or fit.json files; or a pipeline file with a "
            "[repeat] table, which is run so often.",
        ),
    ] = None,
    group: Annotated[
        list[str] | None, typer.Option(metavar="NAME=PATTERN", help="A group of runs by a pattern; can be repeated.")
    ] = None,
    track: Annotated[str | None, typer.Option(help="Track, such as dr/fit. [default: the only one]")] = None,
    parameter: Annotated[str, typer.Option(help="Parameter, or surface.")] = "elasticity",
    picture: Annotated[
        Path | None, typer.Option(help="Draw histogram, autocorrelation, moving average and force error here.")
    ] = None,
    truth: Annotated[
        str | None, typer.Option(help='What it is known to be, such as "282.1 kPa": prints the error of each group.')
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the runs of a pipeline file; must be new or empty.")
    ] = None,
    overrides: Overrides = None,
    scheduler: SchedulerOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as JSON.")] = False,
    layout: FormatOption = "table",
) -> None:
    """Mean, standard uncertainty, autocorrelation, trend and histogram over many runs; tests between groups.

    Between two groups Welch's t-test; of three or more Welch's analysis of variance and Games and Howell's test, too.
    """
    files = _groups(sources or [], group or [])
    files = {
        name: [run for path in paths for run in _runs(path, overrides, out, scheduler)] for name, paths in files.items()
    }
    estimated = Estimated()
    groups = {name: _Group(name) for name in files}
    for name, paths in files.items():
        for path in paths:
            groups[name].read(path, estimated, track, parameter)
        groups[name].demand_values(parameter)
    unit = list(groups.values())[-1].unit
    found = {name: found.values for name, found in groups.items()}
    failures = dict.fromkeys(path for found in groups.values() for path in found.failures)
    rejected = {run: reason for found in groups.values() for run, reason in found.rejected.items()}
    skipped = sum(found.skipped for found in groups.values())
    counted = {"parameter": parameter, "unit": unit, "skipped": skipped, "rejected": rejected}
    document = finite_tree({**counted, **repeatability(found)})
    for name, of_group in groups.items():
        document["groups"][name]["force_error"] = finite_tree(force_error(of_group.tracked))
    if truth is not None:
        known = _truth(truth, unit)
        for name, values in found.items():
            document["groups"][name]["truth"] = against_truth(np.array(values), np.array(groups[name].stated), known)
    if picture is not None:
        draw_repeatability(document, picture)
    _show(document, as_json)
    if failures:
        typer.echo(f"{len(failures)} runs failed: {', '.join(failures)}", err=True)
        raise typer.Exit(1)


def _show(document: dict[str, Any], as_json: bool) -> None:
    """Print what was found."""
    if as_json:
        typer.echo(json.dumps(document, indent=2))
        return
    terminal = console()
    for view in _views(document):
        terminal.print(view, highlight=False, markup=False)


def _runs(path: Path, overrides: list[str] | None, out: Path | None, scheduler: str | None) -> list[Path]:
    """The runs of a source: those in a folder of them, or those made of a pipeline file. Raises UserError."""
    if path.suffix == ".toml" and path.is_file():
        return perform(path, overrides or [], out, scheduler)
    if path.is_dir() and not any((path / name).exists() for name in ("fit.json", "result.json")):
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


def _views(document: dict[str, Any]) -> Iterator[Any]:
    from rich.table import Table

    word, factor = people(document["unit"])
    table = Table(title=f"{document['parameter']} [{word}]", title_justify="left")
    headings = ("group", "n", "mean", "std", "of mean", "correlation\nof neighbours", "correlation\nwith order (p)")
    for heading in headings:
        table.add_column(heading, justify="left" if heading == "group" else "right")
    for name, found in document["groups"].items():
        table.add_row(name, str(found["count"]), *_statistics(found, factor))
    yield table
    for name, found in document["groups"].items():
        yield from _histogram(name, found, factor)
        if found["moving_average"]:
            ends = found["moving_average"][0] * factor, found["moving_average"][-1] * factor
            over = found["moving_average_window"]
            yield f"{name}: moving average over {over} goes from {ends[0]:.5g} to {ends[1]:.5g} {word}"
    for name, found in document["groups"].items():
        if (band := found["force_error"]) is not None:
            largest = max(band["mean"], key=abs)
            yield (
                f"{name}: force less model over {band['count']} runs: {1e3 * band['rms']:.3g} mN RMS, mean at most "
                f"{1e3 * largest:+.3g} mN"
            )
    for name, found in document["groups"].items():
        if error := found.get("truth"):
            said = f"{100 * error['error']:+.2f} ± {100 * error['error_std']:.2g} %"
            scatter = f"{100 * error['by_scatter']:.2g} %"
            yield f"{name}: {said} from {error['truth'] * factor:.5g} {word} (scatter alone {scatter})"
    if whole := document["anova"]:
        pairs = ", ".join(f"{row['first']} and {row['second']} p = {row['p']:.2g}" for row in whole["pairs"])
        yield f"Welch's analysis of variance: F = {whole['f']:.3g}, p = {whole['p']:.2g}; Games-Howell: {pairs}"
    if document["tests"]:
        yield _tests(document["tests"], word, factor)
        yield _CAUTION
    for name, reason in document["rejected"].items():
        yield f"{name} was rejected and is left out: {reason}"
    if document["skipped"]:
        yield f"{document['skipped']} runs without a value, or with an invalid one, were left out"


def _statistics(found: dict[str, Any], factor: float) -> list[str]:
    std = (found["std"] or 0.0) * factor
    trend = found["correlation_with_order"]
    return [
        measured(found["mean"] * factor, (found["std_of_mean"] or 0.0) * factor),
        f"{std:.3g}",
        f"{(found['std_of_mean'] or 0.0) * factor:.3g}",
        "-" if found["correlation"] is None else f"{found['correlation']:+.2f}",
        "-" if trend is None else f"{trend:+.2f} ({found['correlation_with_order_p']:.2g})",
    ]


def _histogram(name: str, found: dict[str, Any], factor: float) -> Iterator[str]:
    counts, edges = found["histogram"]["counts"], found["histogram"]["edges"]
    tallest = max(counts, default=0)
    if tallest:
        yield f"{name}:"
    for count, low, high in zip(counts, edges, edges[1:], strict=False):
        yield f"  {low * factor:10.5g} .. {high * factor:10.5g}  {'#' * round(_BAR * count / tallest)} {count}"


def _tests(rows: list[dict[str, Any]], word: str, factor: float) -> Any:
    from rich.table import Table

    table = Table(title="Welch's t-test", title_justify="left")
    for heading in ("difference of", f"means\n{word}", "t", "degrees of\nfreedom", "p"):
        table.add_column(heading, justify="left" if heading == "difference of" else "right")
    for row in rows:
        cells = ["-" if row[key] is None else f"{row[key]:.3g}" for key in ("t", "degrees_of_freedom", "p")]
        table.add_row(row["difference_is"], f"{row['difference'] * factor:+.4g}", *cells)
    return table
