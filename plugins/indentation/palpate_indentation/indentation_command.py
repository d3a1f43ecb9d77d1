"""``palpate fit indentation``: a press as a whole."""

from __future__ import annotations

import csv
import io
import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from palpate import ConfigurationError, to_si
from palpate_engine import make_folder, withdraw_folder, write_new
from palpate_kit.terminal.fact_options import with_facts
from palpate_kit.terminal.json_output import print_aside, print_json
from palpate_kit.terminal.options import FolderOption, JsonOption, Overrides
from palpate_kit.terminal.table import console

from palpate_indentation.curve_source import WholeCurve, whole_record
from palpate_indentation.elastic_law import ElasticLaw, law_of
from palpate_indentation.modulus_over_depth import ModulusProfile
from palpate_indentation.press import press_of
from palpate_indentation.press_analysis import Indentation, PressSettings, analyse_press
from palpate_indentation.press_budget import Declared
from palpate_indentation.press_table import table
from palpate_indentation.press_views import views
from palpate_indentation.viscosity import PressViscosity, viscosity_of_run

_NOT_PARAMETER = "write NAME=VALUE, such as viscosity='362 Pa*s'"


@with_facts
def indentation(
    source: Annotated[
        Path, typer.Argument(metavar="SOURCE", help="A run folder, a log that palpate wrote, or a pipeline file.")
    ],
    model: Annotated[str | None, typer.Option(help="Which [model.NAME] of several.")] = None,
    overrides: Overrides = None,
    parameters: Annotated[
        list[str] | None,
        typer.Option("--parameter", metavar="NAME=VALUE", help="Another parameter of the model that is known. [0]"),
    ] = None,
    between: Annotated[
        str | None, typer.Option(metavar="BEGIN..END", help="Only this stretch, such as '3 s..8 s'. [default: all]")
    ] = None,
    tilt: Annotated[bool, typer.Option(help="Fit a line, not a constant, to the force in air.")] = True,
    robust: Annotated[bool, typer.Option("--robust", help="Let readings beyond 1.5 sigma count less.")] = False,
    retract: Annotated[bool, typer.Option("--retract", help="Fit the way out in place of the way in.")] = False,
    bins: Annotated[int, typer.Option(help="Bins of depth for E from the contact point on.", min=4, max=1000)] = 40,
    windows: Annotated[int, typer.Option(help="Windows of depth for E by itself.", min=2, max=200)] = 8,
    out: FolderOption = None,
    as_json: JsonOption = False,
) -> None:
    """Look at one press as a whole: modulus over depth, contact point by all methods, baseline, adhesion, large strain.

    The first press of the record is taken, or that of --between. Writes indentation.json, depth.csv, windows.csv,
    contact_points.csv and indentation.png.
    """
    whole = whole_record(source, overrides or (), model)
    stated, stretch = _stated_parameters(parameters or []), _stretch(between)
    law_of(whole.model, whole.model_name, stated)  # its mistakes are reported before those of the record
    press = press_of(whole.samples, stretch, str(source), segment=whole.segment, tip_mass=whole.alignment.tip_mass)
    law = law_of(whole.model, whole.model_name, stated, reach=float(np.ptp(press.approach.height)))
    analysis = analyse_press(
        law,
        press,
        PressSettings(tilt=tilt, robust=robust, bins=bins, windows=windows, retract=retract),
        str(source),
        viscosity=_run_viscosity(whole, law),
        declared=Declared(whole.alignment, whole.uncertainties),
    )

    # A folder that is not complete is removed.
    folder = make_folder("indentation", out, datetime.now(UTC).astimezone())
    document = {"source": str(source), "model": whole.model_name, **table(analysis)}
    try:
        _write(folder, analysis, document)
    except BaseException:
        withdraw_folder(folder)
        raise
    with print_aside(as_json):
        for view in views(analysis, whole.model_name):
            console().print(view if isinstance(view, str) else view.view(), highlight=False)
        typer.echo(f"written to {folder}")
    if as_json:
        print_json({**document, "folder": folder})


def _run_viscosity(whole: WholeCurve, law: ElasticLaw) -> PressViscosity | None:
    """Return the viscosity of the run that a record comes from; None where model or tip differ from that run's."""
    if law.viscosity is None or whole.changed:
        return None
    parameter, _, _ = law.viscosity
    return viscosity_of_run(whole.place, whole.model_name, parameter)


def _stated_parameters(assignments: list[str]) -> dict[str, str]:
    """Return the values of ``NAME=VALUE``, with quotes removed; raises ConfigurationError."""
    parameters = {}
    for assignment in assignments:
        name, equals, value = assignment.partition("=")
        if not equals:
            raise ConfigurationError(f"--parameter {assignment}: {_NOT_PARAMETER}")
        parameters[name.strip()] = value.strip().strip("\"'")
    return parameters


def _stretch(text: str | None) -> tuple[float, float] | None:
    """Return the ends [s] of ``BEGIN..END``; None for all of the record. Raises ConfigurationError."""
    if text is None:
        return None
    begin, dots, end = (part.strip() for part in text.partition(".."))
    try:
        low, high = to_si(begin, "s"), to_si(end, "s")
    except ValueError as error:
        raise ConfigurationError(f"--between {text}: write '3 s..8 s': {error}") from error
    if not dots or low >= high:
        raise ConfigurationError(f"--between {text}: ends before it begins")
    return low, high


def _write(folder: Path, analysis: Indentation, document: dict[str, Any]) -> None:
    """Write the document, its tables and the picture to a folder."""
    from palpate_indentation.press_figure import draw

    write_new(folder / "indentation.json", json.dumps(document, indent=2, allow_nan=False) + "\n")
    write_new(folder / "depth.csv", _profile_csv(analysis.secant, analysis.law.unit))
    write_new(folder / "windows.csv", _profile_csv(analysis.tangent, analysis.law.unit))
    rows = [["method", "surface [m]", "if the fit were true [m]", "std [m]"]]
    for name, point in analysis.points.items():
        rows.append([name, f"{point.surface:.9g}", f"{point.usual:.9g}", f"{point.std:.9g}"])
    write_new(folder / "contact_points.csv", _csv(rows))
    draw(analysis, folder / "indentation.png")


def _profile_csv(profile: ModulusProfile, unit: str) -> str:
    """Return the rows of a profile as CSV; a number that is NaN is empty."""
    headings = [
        "depth from [m]",
        "depth to [m]",
        f"modulus [{unit}]",
        "std by noise",
        "std by contact point",
        "combined std",
    ]
    columns = (profile.begin, profile.end, profile.modulus, profile.noise, profile.contact, profile.std)
    rows = [[_csv_number(value) for value in row] for row in zip(*columns, strict=True)]
    return _csv([headings, *rows])


def _csv_number(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.9g}"


def _csv(rows: list[list[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
