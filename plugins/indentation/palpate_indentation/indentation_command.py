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
from palpate_engine import display_unit, make_folder, withdraw_folder, write_new
from palpate_kit.figures import force_unit
from palpate_kit.terminal.fact_options import with_facts
from palpate_kit.terminal.json_output import print_aside, print_json
from palpate_kit.terminal.options import FolderOption, JsonOption, Overrides
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table, console

from palpate_indentation.curve_source import WholeCurve, whole_record
from palpate_indentation.elastic_law import ElasticLaw, law_of
from palpate_indentation.modulus_over_depth import ModulusProfile
from palpate_indentation.press import press_of
from palpate_indentation.press_analysis import Indentation, PressSettings, analyse_press, contributions
from palpate_indentation.press_budget import Declared
from palpate_indentation.press_table import bic_above_best, second_best, table
from palpate_indentation.viscosity import PressViscosity, viscosity_of_run

_SHOWN = 0.05  # of the combined uncertainty; less of a part is in indentation.json only
_DECISIVE = 10.0  # of BIC
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
    assigned, stretch = _assigned(parameters or []), _stretch(between)
    law_of(whole.model, whole.model_name, assigned)  # whose mistakes come before those of the record
    press = press_of(whole.samples, stretch, str(source), segment=whole.segment, tip_mass=whole.alignment.tip_mass)
    law = law_of(whole.model, whole.model_name, assigned, float(np.ptp(press.approach.height)))
    settings = PressSettings(tilt, robust, bins, windows, retract)
    found = analyse_press(
        law, press, settings, str(source),
        viscosity=_of_run(whole, law), declared=Declared(whole.alignment, whole.uncertainties),
    )  # fmt: skip
    folder = make_folder("indentation", out, datetime.now(UTC).astimezone())
    document = {"source": str(source), "model": whole.model_name, **table(found)}
    try:
        _write(folder, found, document)
    except BaseException:
        withdraw_folder(folder)
        raise
    with print_aside(as_json):
        for view in views(found, whole.model_name):
            console().print(view if isinstance(view, str) else view.view(), highlight=False)
        typer.echo(f"written to {folder}")
    if as_json:
        print_json({**document, "folder": folder})


def _of_run(whole: WholeCurve, law: ElasticLaw) -> PressViscosity | None:
    """The viscosity of the run that a record comes from; None where model or tip differ from that run's."""
    if law.viscosity is None or whole.changed:
        return None
    return viscosity_of_run(whole.place, whole.model_name, law.viscosity[0])


def _assigned(given: list[str]) -> dict[str, str]:
    found = {}
    for assignment in given:
        name, equals, value = assignment.partition("=")
        if not equals:
            raise ConfigurationError(f"--parameter {assignment}: {_NOT_PARAMETER}")
        found[name.strip()] = value.strip().strip("\"'")
    return found


def _stretch(text: str | None) -> tuple[float, float] | None:
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


def views(found: Indentation, model: str) -> list[Any]:
    """Tables and sentences for people."""
    unit = found.law.unit
    word, factor = display_unit(unit)
    fit = found.fit
    length, per_length = _length(found.depth)
    shares = zip(found.budget, contributions(found.law, found.budget), strict=True)
    parts = [f"{row.source} {factor * share:.3g}" for row, share in shares if share > _SHOWN * found.combined]
    shown: list[Any] = [
        f"{model}: {found.law.name} {value_with_uncertainty(factor * fit.modulus, factor * found.combined)} {word} "
        f"({', '.join(parts)} {word}); "
        f"{per_length * found.depth:.3g} {length} deep; residual {_force(fit.rms)}, noise {_force(found.press.noise)}"
    ]
    if (way_in := table(found)["adhesion_on_the_way_in"]) is not None:
        work = value_with_uncertainty(1e3 * way_in["adhesion_work"], 1e3 * way_in["adhesion_work_std"])
        plain = f"{factor * way_in['value_without']:.4g} {word}"
        shown.append(f"the way in sticks: by {way_in['theory']}, work of adhesion {work} mJ/m^2; without it {plain}")
    if (viscosity := found.viscosity) is not None:
        name, scaled = display_unit(viscosity.unit)
        value = value_with_uncertainty(scaled * viscosity.value, scaled * viscosity.std)
        shown.append(f"viscosity taken off: {value} {name} ({viscosity.words})")
    tilted = found.fitted.untold or fit
    if tilted.tilt_std > 0:
        reach = float(found.branch.height.max() - found.branch.height.min())
        by = f"tilted by {_force(tilted.tilt * reach)} +- {_force(tilted.tilt_std * reach)} over the way"
        shown.append(f"baseline: {by}" if tilted is fit else f"baseline: level; least squares would have it {by}")
    rows = [
        (
            name,
            f"{per_length * (point.surface - fit.surface):+.4g}",
            f"{per_length * (point.usual - fit.surface):+.4g}",
            f"{per_length * point.odd:+.3g}", f"{per_length * point.std:.2g}",
        )
        for name, point in found.points.items()
    ]  # fmt: skip
    headings = ("by", f"above the fit [{length}]", "if the fit were true", "difference", "std")
    shown.append(Table.of("contact point", headings, rows, ("by",)))
    shown.append(_depths(found, word, factor, length, per_length))
    if found.spheres:
        laws = [
            (
                f"{one.tip}{' (chosen)' * one.chosen}", f"{factor * one.fit.modulus:.5g}",
                f"{factor * one.fit.modulus_std:.2g}", _force(one.fit.rms),
                f"{bic_above_best(one, found):.3g}",
            )
            for one in found.spheres
        ]  # fmt: skip
        headings = ("law of the sphere", f"E [{word}]", "std", "residual", "BIC above best")
        shown.append(Table.of("shape and large strain", headings, laws, ("law of the sphere",)))
        if (second := second_best(found)) is not None and second < _DECISIVE:
            shown.append("shape and large strain: the press does not distinguish these laws")
    if found.pull is not None:
        shown += _adhesion(found, word, factor)
    shown += [f"{flag.code}: {flag.message}" for flag in found.flags]
    return shown


def _depths(found: Indentation, word: str, factor: float, length: str, per_length: float) -> Table:
    rows = [
        (f"{per_length * begin:.3g} to {per_length * end:.3g}", f"{factor * value:.4g}", f"{factor * std:.2g}")
        for begin, end, value, std in zip(
            found.tangent.begin, found.tangent.end, found.tangent.modulus, found.tangent.std, strict=True
        )
    ]
    return Table.of(f"{found.law.name} within windows of depth", (f"depth [{length}]", f"E [{word}]", "std"), rows)


def _adhesion(found: Indentation, word: str, factor: float) -> list[Any]:
    assert found.pull is not None
    said: list[Any] = [f"pull-off: {_force(found.pull.force)} +- {_force(found.pull.std)}"]
    if not found.theories:
        said.append("adhesion: modulus and work of adhesion are determined for spheres only")
        return said
    rows = [
        (
            name, f"{factor * one['value']:.4g}", f"{factor * one['std']:.2g}", f"{1e3 * one['adhesion_work']:.4g}",
            f"{1e3 * one['adhesion_work_std']:.2g}", _force(one["rms"]), f"{one['tabor']:.3g}",
        )
        for name, one in table(found)["adhesion"].items()
    ]  # fmt: skip
    headings = ("theory", f"E [{word}]", "std", "w [mJ/m^2]", "std", "residual", "Tabor's parameter")
    said.append(Table.of("adhesion on the way out", headings, rows, ("theory",)))
    said.append("Tabor's parameter above 5 speaks for jkr, below 0.1 for dmt, between for neither")
    return said


def _length(depth: float) -> tuple[str, float]:
    return ("mm", 1e3) if depth > 1e-4 else ("um", 1e6) if depth > 1e-7 else ("nm", 1e9)


def _force(value: float) -> str:
    unit, factor = force_unit(abs(value))
    return f"{factor * value:.3g} {unit}"


def _write(folder: Path, found: Indentation, document: dict[str, Any]) -> None:
    from palpate_indentation.press_figure import draw

    write_new(folder / "indentation.json", json.dumps(document, indent=2, allow_nan=False) + "\n")
    write_new(folder / "depth.csv", _profile_csv(found.secant, found.law.unit))
    write_new(folder / "windows.csv", _profile_csv(found.tangent, found.law.unit))
    lines = [["method", "surface [m]", "if the fit were true [m]", "std [m]"]]
    lines += [
        [name, f"{point.surface:.9g}", f"{point.usual:.9g}", f"{point.std:.9g}"] for name, point in found.points.items()
    ]
    write_new(folder / "contact_points.csv", _csv(lines))
    draw(found, folder / "indentation.png")


def _profile_csv(profile: ModulusProfile, unit: str) -> str:
    head = [
        "depth from [m]",
        "depth to [m]",
        f"modulus [{unit}]",
        "std by noise",
        "std by contact point",
        "combined std",
    ]
    columns = (profile.begin, profile.end, profile.modulus, profile.noise, profile.contact, profile.std)
    rows = [[f"{value:.9g}" if value == value else "" for value in row] for row in zip(*columns, strict=True)]
    return _csv([head, *rows])


def _csv(rows: list[list[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
