"""``palpate material fit``: laws for tables of rheometers, DMAs and dynamometers, alone or together with palpations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from palpate import ConfigurationError, Floats, printable, suggest, to_si
from palpate_engine import POISSON_STD, make_folder, write_new
from palpate_kit.numerics.material_laws import LAWS, LinearLaw
from palpate_kit.terminal.json_output import json_text, print_aside, print_json
from palpate_kit.terminal.options import FolderOption, FormatOption, JsonOption
from palpate_kit.terminal.table import console

from palpate_reference.cards.prony_series import MATERIAL
from palpate_reference.decade_series import DECADES, decade_series
from palpate_reference.fit_problem import FitProblem
from palpate_reference.fit_sources import read_sources
from palpate_reference.hyperelastic.curve_fit import Loading, fit_curves, stress_curves
from palpate_reference.hyperelastic.strain_energies import HYPERELASTIC, HyperelasticLaw, stable_stretches
from palpate_reference.law_fit import AnyFit, TableFit, law_document, law_table, remarks, supported_fits, value_table
from palpate_reference.material_table import MaterialTable
from palpate_reference.superposition.master_command import (
    ByOption,
    ReferenceOption,
    VerticalOption,
    curve_at,
    superposition_remarks,
)
from palpate_reference.table_fit import fit_law
from palpate_reference.table_options import ColumnOption, ModulusOption, UnitOption, table_settings


def fit_material(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="SOURCE...", help="Tables, also those of `palpate fit spectrum`; run folders of a sine."
        ),
    ],
    laws: Annotated[list[str] | None, typer.Option("--law", help="Law; can be repeated. [default: all]")] = None,
    scale: Annotated[
        str | None,
        typer.Option(metavar="PERCENT", help="Standard uncertainty of a table's scale (gap, geometry), such as '2 %'."),
    ] = None,
    poisson: Annotated[float, typer.Option(min=0.0, max=0.5, help="Poisson's ratio.")] = 0.5,
    loading: Annotated[
        Loading | None, typer.Option(help="Of curves of stress over strain where no name says it.")
    ] = None,
    reference: ReferenceOption = None,
    vertical: VerticalOption = False,
    by: ByOption = "moduli",
    units: UnitOption = None,
    modulus: ModulusOption = None,
    columns: ColumnOption = None,
    out: FolderOption = None,
    as_json: JsonOption = False,
    layout: FormatOption = "table",
) -> None:
    """Fit laws of linear or hyperelastic materials to tables of one material together, and choose among them.

    The linear laws and their parameters are those of the contact models of the same names. A run of a sine is G' and
    G'' at its frequency; `palpate fit spectrum` writes tables of many. With --reference-temperature sweeps at several
    temperatures are shifted first, as by `palpate material master`; runs are taken as at that temperature. Stress over
    strain is nominal, of an incompressible solid. Writes material.json and fit.png.
    """
    tables = read_sources(sources, table_settings(units, modulus, columns), poisson)
    shifts = reference is not None or vertical
    if tables[0].kind == "stress-strain":
        if shifts:
            raise ConfigurationError("--reference-temperature: stress over strain has no time that could be shifted")
        report = _hyperelastic_report(tables, laws, _share(scale), loading)
    elif shifts:
        runs = [table for table in tables if table.format == "run"]
        sweeps = [table for table in tables if table.format != "run"]
        curve = curve_at(sweeps, reference, vertical, by == "storage")
        report = _linear_report([curve.table(), *runs], laws, _share(scale), poisson, curve.shift_root())
        report.document["remarks"] += superposition_remarks(curve, ())
    else:
        report = _linear_report(tables, laws, _share(scale), poisson, shift_root=None)
    folder = make_folder("material", out, datetime.now(UTC).astimezone())
    write_new(folder / MATERIAL, json_text(report.document))
    report.draw(folder / "fit.png")
    if as_json:
        print_json({"folder": folder, **report.document})
        return
    with print_aside(False):
        _show(report.fits, report.document["remarks"])
    typer.echo(f"written to {folder}: {MATERIAL}, fit.png", err=layout != "table")


class _MaterialReport(NamedTuple):
    """Fits, the best first, their document, and a function that draws their figure."""

    fits: Sequence[AnyFit]
    document: dict[str, Any]
    draw: Callable[[Path], None]


def _linear_report(
    tables: Sequence[MaterialTable],
    laws: Sequence[str] | None,
    scale: float,
    poisson: float,
    shift_root: Floats | None,
) -> _MaterialReport:
    """Return the report of linear laws; with a `shift_root` the first table is a master curve."""
    from palpate_reference.fit_figure import draw_fits

    fits = material_fits(tables, laws, scale, poisson, shift_root)
    drawn_fits = supported_fits(fits) or fits[:1]
    return _MaterialReport(
        fits, document(fits, tables, poisson), lambda path: draw_fits(drawn_fits, tables, poisson, path)
    )


def _hyperelastic_report(
    tables: Sequence[MaterialTable], laws: Sequence[str] | None, scale: float, loading: Loading | None
) -> _MaterialReport:
    """Return the report of hyperelastic laws."""
    from palpate_reference.fit_figure import draw_curves

    fits, curves = curve_fits(tables, laws, scale, loading), stress_curves(tables, loading)
    return _MaterialReport(
        fits, curve_document(fits, tables), lambda path: draw_curves(supported_fits(fits), curves, path)
    )


def _share(scale: str | None) -> float:
    """Return a relative uncertainty, written as '2 %' or as a number without unit; 0 for none."""
    if scale is None:
        return 0.0
    try:
        text = scale.strip()
        share = float(text.removesuffix("%")) / 100.0 if text.endswith("%") else to_si(scale, "1")
    except ValueError as error:
        raise ConfigurationError(f"--scale {scale!r}: write for example '2 %'") from error
    if not 0 <= share < 1:
        raise ConfigurationError(f"--scale {scale!r}: must be from 0 to 100 %")
    return share


def material_fits(
    tables: Sequence[MaterialTable],
    names: Sequence[str] | None,
    scale: float,
    poisson: float,
    shift_root: Floats | None = None,
) -> list[TableFit[LinearLaw]]:
    """Return the fits of every law, or of those of names, by BIC.

    Raises ConfigurationError for an unknown name, and where no law can be fitted.
    """
    law_names = [*(law.name for law in LAWS), DECADES]
    for name in names or ():
        if name not in law_names:
            raise ConfigurationError(f"--law: no law {name!r}{suggest(name, law_names)}")
    # Poisson's ratio counts for moduli of shear; the scale of a run is in its own uncertainty.
    poisson_std = POISSON_STD if any(table.shear for table in tables) else 0.0
    scales = tuple(0.0 if table.format == "run" else scale for table in tables)
    problem = FitProblem(tuple(tables), poisson, poisson_std, scales, shift_root)
    laws = _selected_laws(names or law_names, problem)
    fits = [fit_law(law, problem) for law in laws]
    ordered = sorted((fit for fit in fits if fit is not None), key=lambda fit: fit.bic)
    if not ordered:
        raise ConfigurationError(
            f"{problem.count} readings are too few for every law, or of a kind that it cannot have"
        )
    return ordered


def _selected_laws(names: Sequence[str], problem: FitProblem) -> list[LinearLaw]:
    """Return the laws of these names; the series of decades depends on the tables, which may have none."""
    laws = [law for law in LAWS if law.name in names]
    series = decade_series(problem) if DECADES in names else None
    return laws if series is None else [*laws, series]


def curve_fits(
    tables: Sequence[MaterialTable], names: Sequence[str] | None, scale: float, loading: Loading | None
) -> list[TableFit[HyperelasticLaw]]:
    """Return the fits of every hyperelastic law, or of those of names, by BIC.

    Raises ConfigurationError for an unknown name, and where no law can be fitted.
    """
    law_names = [law.name for law in HYPERELASTIC]
    for name in names or ():
        if name not in law_names:
            raise ConfigurationError(f"--law: no law {name!r} of stress over strain{suggest(name, law_names)}")
    curves = stress_curves(tables, loading)
    fits = [fit_curves(law, curves, scale) for law in HYPERELASTIC if not names or law.name in names]
    ordered = sorted((fit for fit in fits if fit is not None), key=lambda fit: fit.bic)
    if not ordered:
        count = sum(len(curve.x) for curve in curves)
        raise ConfigurationError(f"{count} readings are too few for every law, or of a kind that it cannot have")
    return ordered


def _show(fits: Sequence[AnyFit], doubts: Sequence[str]) -> None:
    """Print the laws, the values of the best, and what is doubtful."""
    screen = console()
    screen.print(law_table(fits).view(), highlight=False)
    screen.print(value_table(fits[0]).view(), highlight=False)
    for line in doubts:
        screen.print(printable(line), style="yellow", highlight=False)


def document(fits: Sequence[TableFit[LinearLaw]], tables: Sequence[MaterialTable], poisson: float) -> dict[str, Any]:
    """Return linear laws as plain data [SI]; the best law first."""
    supported = supported_fits(fits)
    laws = [
        {**law_document(fit, fit in supported), "times": fit.law.times, "log_covariance": fit.covariance.tolist()}
        for fit in fits
    ]
    return {**_sources(tables), "poisson": poisson, "laws": laws, "remarks": remarks(fits)}


def curve_document(fits: Sequence[TableFit[HyperelasticLaw]], tables: Sequence[MaterialTable]) -> dict[str, Any]:
    """Return hyperelastic laws as plain data [SI]; the best law first, with a remark if it is not always stable."""
    supported = supported_fits(fits)
    ranges = [stable_stretches(fit.law, fit.values.tolist()) for fit in fits]
    laws = [
        {
            **law_document(fit, fit in supported),
            "stable_stretches": stable_range,
            "covariance": fit.covariance.tolist(),
        }
        for fit, stable_range in zip(fits, ranges, strict=True)
    ]
    doubts = remarks(fits)
    # A neo-Hookean solid is stable over all stretches that are examined.
    if ranges[0] != stable_stretches(HYPERELASTIC[0], [1.0]):
        low, high = ranges[0]
        doubts.append(f"{fits[0].law.name}: the stress rises between stretches of {low:.3g} and {high:.3g} alone")
    return {**_sources(tables), "poisson": 0.5, "laws": laws, "remarks": doubts}


def _sources(tables: Sequence[MaterialTable]) -> dict[str, Any]:
    sources = [{"name": table.name, "kind": table.kind, "shear": table.shear, "rows": len(table.x)} for table in tables]
    return {"sources": sources}
