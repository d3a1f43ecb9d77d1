"""``palpate plan design``: how well a palpation can do, and which setting does best."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from palpate import ConfigurationError
from palpate_engine import finite_tree, load_pipeline
from palpate_kit.terminal.options import Overrides
from palpate_kit.terminal.table import console

from palpate_studies.design.palpation import Case

if TYPE_CHECKING:
    from palpate_studies.design.palpation import Palpation
    from palpate_studies.design.pipeline_design import Design


_CASES: dict[Case, str] = {  # what is not known, in a heading's words
    "known": "all known",
    "unknown skew": "timing ?",
    "unknown bias": "offset ?",
    "unknown both": "both ?",
}


_ADVICE = (
    "{}: this model remembers, and its force does not follow from depth and rate alone: there are no bounds for it "
    "here. Design for dimensionality-reduction with the elasticity and viscosity that the material has at the "
    "frequency of the palpation, and add a slower or faster palpation to tell a relaxation"
)


def design(
    file: Annotated[Path, typer.Argument(help="The pipeline file.")],
    picture: Annotated[Path | None, typer.Option(help="Draw the bounds into this file (.png, .svg or .pdf).")] = None,
    overrides: Overrides = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print every bound in SI instead of the tables.")] = False,
) -> None:
    """Show how well elasticity and viscosity can be told at best, over frequency and amplitude, and what is best.

    Cramer-Rao bounds for the pipeline's models, tip and trajectory, with timing and offset of the force known and not.
    """
    from palpate_studies.design.pipeline_design import run_design

    pipeline = load_pipeline(file, overrides or [])
    remembering = [name for name, model in pipeline.models.items() if model.memory]
    if len(remembering) == len(pipeline.models):
        raise ConfigurationError(f"{file}: {_ADVICE.format(', '.join(remembering))}")
    designs = [run_design(pipeline, name) for name, model in pipeline.models.items() if not model.memory]
    if as_json:
        typer.echo(json.dumps(finite_tree({found.name: _plain(found) for found in designs}), indent=2))
        return
    terminal = console(140)
    for found in designs:
        terminal.print(_table(found))
        terminal.print(_recommendation(found), highlight=False, markup=False)
    if remembering:
        terminal.print(f"left out: {_ADVICE.format(', '.join(remembering))}", highlight=False, markup=False)
    if picture is not None:
        from palpate_studies.design.design_figure import draw

        draw(designs, picture)
        terminal.print(f"drawn to {picture}", highlight=False)


def _plain(found: Design) -> dict[str, Any]:
    """A design as plain data [SI]."""
    rows = [
        {
            "frequencies": list(item.frequencies),
            "amplitude": item.amplitude,
            "travel": item.travel,
            "refused": item.refused,
            "recommended": item is found.recommended,
            "bias": dict(item.bounds["known"].bias),
            "bounds": {case: {**bound.parameters, "surface": bound.surface} for case, bound in item.bounds.items()},
        }
        for item in found.palpations
    ]
    return {"expected": dict(found.theta), "duration": found.duration, "palpations": rows}


def _table(found: Design) -> object:
    from rich.table import Table

    table = Table(title=f"{found.name}: bounds in % of {_expected(found)}", title_justify="left")
    table.add_column("Hz")
    for heading in ("mm", "real mm"):
        table.add_column(heading, justify="right")
    for symbol in found.symbols:
        for words in (*_CASES.values(), "bias"):
            table.add_column(f"{symbol}\n{words}", justify="right")
    table.add_column("surface\nµm", justify="right")
    table.add_column("")
    chosen = found.recommended
    for item in found.palpations:
        table.add_row(*_cells(found, item), "best" if item is chosen else item.refused or "")
    return table


def _cells(found: Design, item: Palpation) -> list[str]:
    cells = [" + ".join(f"{f:.3g}" for f in item.frequencies), f"{item.amplitude * 1e3:.3g}"]
    cells.append(f"{item.travel * 1e3:.3g}")
    for name in found.theta:
        for case in item.bounds:
            cells.append(f"{100 * item.relative(case, found.theta)[name]:.3g}")
        cells.append(f"{100 * item.relative_bias(found.theta)[name]:+.2g}")
    return [*cells, f"{item.bounds['known'].surface * 1e6:.3g}"]


def _expected(found: Design) -> str:
    return ", ".join(f"{name} {value:.4g} {unit}" for (name, value), unit in zip(found.theta.items(), found.units))


def _recommendation(found: Design) -> str:
    item = found.recommended
    if item is None:
        return f"{found.name}: no setting keeps the limits of [design] and tells all parameters"

    def words(case: Case) -> str:
        shares = item.relative_rmse(case, found.theta).items()
        return ", ".join(f"{name} {100 * share:.2g} %" for name, share in shares)

    frequencies = " + ".join(f"{f:.3g}" for f in item.frequencies)
    return (
        f"{found.name}: recommended within the limits: {frequencies} Hz, {item.amplitude * 1e3:.3g} mm each, "
        f"{found.duration:.3g} s: root mean square error {words('known')} after calibration and tare; "
        f"{words('unknown both')} without either"
    )
