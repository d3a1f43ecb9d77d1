"""``palpate material fit``: laws for tables of rheometers and DMAs, alone or together with palpations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from palpate import ConfigurationError, Floats, printable, to_si
from palpate.host import display_unit, make_folder, suggest, write_new
from palpate_kit.terminal.json_output import json_text, print_aside, print_json
from palpate_kit.terminal.options import FolderOption, FormatOption, JsonOption
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table, console

from palpate_reference.cards.prony_series import MATERIAL
from palpate_reference.decade_series import DECADES, decade_series
from palpate_reference.material_laws import LAWS, law_of
from palpate_reference.material_table import MaterialTable, TableSettings
from palpate_reference.run_values import run_values
from palpate_reference.superposition.master_command import ReferenceOption, VerticalOption, curve_at
from palpate_reference.table_fit import FitProblem, TableFit, fit_law, supported_fits
from palpate_reference.table_options import ModulusOption, UnitOption, table_settings
from palpate_reference.table_reader import read_tables

_SMALL = 0.05  # share of an uncertainty that is not printed
_POISSON_STD = 0.02 / math.sqrt(3)  # as runs take it: known within 0.02 below its value


def fit_material(
    sources: Annotated[
        list[Path],
        typer.Argument(metavar="SOURCE...", help="Tables, also those of `palpate spectrum`; run folders of a sine."),
    ],
    laws: Annotated[list[str] | None, typer.Option("--law", help="Law; can be repeated. [default: all]")] = None,
    scale: Annotated[
        str | None,
        typer.Option(metavar="PERCENT", help="Standard uncertainty of a table's scale (gap, geometry), such as '2 %'."),
    ] = None,
    poisson: Annotated[float, typer.Option(min=0.0, max=0.5, help="Poisson's ratio.")] = 0.5,
    reference: ReferenceOption = None,
    vertical: VerticalOption = False,
    units: UnitOption = None,
    modulus: ModulusOption = None,
    out: FolderOption = None,
    as_json: JsonOption = False,
    layout: FormatOption = "table",
) -> None:
    """Fit laws of linear materials to tables of one material together, and choose among them.

    The laws and their parameters are those of the contact models of the same names. A run of a sine is G' and G'' at
    its frequency; `palpate spectrum` writes tables of many. With --reference-temperature sweeps at several temperatures
    are shifted first, as by `palpate material master`; runs are taken as at that temperature. Writes material.json and
    fit.png.
    """
    tables = read_sources(sources, table_settings(units, modulus), poisson)
    root = None
    if reference is not None or vertical:
        curve = curve_at([table for table in tables if table.format != "run"], reference, vertical)
        tables, root = [curve.table(), *(table for table in tables if table.format == "run")], curve.shift_root()
    fits = material_fits(tables, laws, _share(scale), poisson, root)
    folder = make_folder("material", out, datetime.now(UTC).astimezone())
    write_new(folder / MATERIAL, json_text(document(fits, tables)))
    from palpate_reference.fit_figure import draw_fits

    draw_fits(supported_fits(fits) or fits[:1], tables, folder / "fit.png")
    if as_json:
        print_json({"folder": folder, **document(fits, tables)})
        return
    with print_aside(False):
        _show(fits)
    typer.echo(f"written to {folder}: {MATERIAL}, fit.png", err=layout != "table")


def _share(scale: str | None) -> float:
    try:
        share = to_si(scale, "1") if scale is not None and not scale.strip().endswith("%") else _percent(scale)
    except ValueError as error:
        raise ConfigurationError(f"--scale {scale!r}: write for example '2 %'") from error
    if not 0 <= share < 1:
        raise ConfigurationError(f"--scale {scale!r}: must be from 0 to 100 %")
    return share


def _percent(scale: str | None) -> float:
    return 0.0 if scale is None else float(scale.strip().removesuffix("%")) / 100.0


def read_sources(sources: Sequence[Path], settings: TableSettings, poisson: float) -> list[MaterialTable]:
    """Tables of files, and one line for each run; raises UserError, also for what no law describes."""
    tables: list[MaterialTable] = []
    for path in sources:
        tables += [_line_of_run(path, poisson)] if path.is_dir() else read_tables(path, settings)
    usable = [one for one in tables if one.kind != "stress-strain"]
    usable = [one for one in usable if one.kind != "oscillation" or len(one.x) == 1 or one.sweeps_frequency]
    if not usable:
        names = ", ".join(f"{one.name} ({one.kind})" for one in tables)
        raise ConfigurationError(
            f"{names}: no modulus over several frequencies or over time, so no law of time follows from it"
        )
    return usable


def _line_of_run(path: Path, poisson: float) -> MaterialTable:
    """G' = E/(2 (1 + nu)) and G'' = 2 pi f eta of a palpation by a sine."""
    elastic, viscous = run_values(path, ("elasticity", "viscosity"), None)
    frequency = elastic.conditions.frequency
    if frequency is None:
        raise ConfigurationError(
            f"{path}: its motion is not one sine, so that E and eta belong to no frequency; give the spectrum.csv or "
            "modulus.csv that `palpate spectrum` makes of it"
        )
    turn = 2.0 * math.pi * frequency
    y = np.array([[elastic.value, turn * 2.0 * (1.0 + poisson) * viscous.value]])
    std = np.array([[elastic.std, turn * 2.0 * (1.0 + poisson) * viscous.std]])
    return MaterialTable(
        path.name, elastic.track, "run", "oscillation", False, np.array([frequency]), y, std, None, None
    )


def material_fits(
    tables: Sequence[MaterialTable],
    names: Sequence[str] | None,
    scale: float,
    poisson: float,
    shift_root: Floats | None = None,
) -> list[TableFit]:
    """Every law, or those of names, by BIC; raises ConfigurationError where none can be fitted."""
    for name in names or ():
        if law_of(name) is None and name != DECADES:
            known = [*(law.name for law in LAWS), DECADES]
            raise ConfigurationError(f"--law: there is no law {name!r}{suggest(name, known)}")
    shear = {table.shear for table in tables}
    std = _POISSON_STD if True in shear else 0.0
    scales = tuple(0.0 if table.format == "run" else scale for table in tables)
    problem = FitProblem(tuple(tables), poisson, std, scales, shift_root)
    series = decade_series(problem) if not names or DECADES in names else None
    laws = [law for law in LAWS if not names or law.name in names] + ([series] if series else [])
    fits = [fit_law(law, problem) for law in laws]
    found = sorted((fit for fit in fits if fit is not None), key=lambda fit: fit.bic)
    if not found:
        raise ConfigurationError(
            f"{problem.count} readings are too few for every law, or of a kind that it cannot have"
        )
    return found


def _show(fits: Sequence[TableFit]) -> None:
    screen = console()
    screen.print(law_table(fits).view(), highlight=False)
    best = fits[0]
    screen.print(value_table(best).view(), highlight=False)
    for line in remarks(fits):
        screen.print(printable(line), style="yellow", highlight=False)


def law_table(fits: Sequence[TableFit]) -> Table:
    """Laws by evidence."""
    standing = supported_fits(fits)
    rows = [
        (
            fit.law.name, ", ".join(f"{100 * s:.2g}" for s in fit.scatter),
            f"{fit.chi2:.3g} / {fit.freedom}" if fit.freedom else "", f"{fit.bic - fits[0].bic:.3g}",
            "supported" if fit in standing else "",
        )
        for fit in fits
    ]  # fmt: skip
    return Table.of("laws", ("law", "residual\n%", "chi^2 / freedom", "BIC above\nthe best", ""), rows, ("law",))


def value_table(fit: TableFit) -> Table:
    """Values of a law, each with its budget."""
    rows = []
    for k, (name, unit) in enumerate(fit.law.parameters):
        word, factor = display_unit(unit)
        text = value_with_uncertainty(factor * float(fit.values[k]), factor * float(fit.stds[k]))
        parts = [
            f"{100 * share[k] / fit.values[k]:.2g} % {source if len(fit.scatter) > 1 else source.split(' of ')[0]}"
            for source, share in fit.budget.items()
            if share[k] > _SMALL * fit.stds[k]
        ]
        rows.append((name, text, "" if word == "1" else word, "; ".join(parts)))
    return Table.of(f"{fit.law.name}: {fit.law.formula}", ("parameter", "value", "unit", "from"), rows, ("parameter",))


def remarks(fits: Sequence[TableFit]) -> list[str]:
    """What is to be doubted of the best law."""
    best, standing = fits[0], supported_fits(fits)
    found = []
    if best.undetermined:
        found.append(f"{best.law.name}: the tables do not determine {', '.join(best.undetermined)}")
    if not standing:
        found.append(f"no law describes the tables within their stated uncertainties (best: p = {best.p:.1g})")
    if len(standing) > 1:
        found.append(f"the tables do not choose between {' and '.join(fit.law.name for fit in standing)}")
    return found


def document(fits: Sequence[TableFit], tables: Sequence[MaterialTable]) -> dict[str, Any]:
    """Everything as plain data [SI]; the best law first."""
    standing = supported_fits(fits)
    return {
        "sources": [{"name": one.name, "kind": one.kind, "shear": one.shear, "rows": len(one.x)} for one in tables],
        "poisson": fits[0].poisson,
        "laws": [
            {
                "law": fit.law.name, "formula": fit.law.formula, "supported": fit in standing, "bic": fit.bic,
                "chi2": fit.chi2, "freedom": fit.freedom, "p": fit.p, "residual": fit.scatter,
                "autocorrelation": fit.autocorrelation, "undetermined": fit.undetermined, "times": fit.law.times,
                "parameters": {
                    name: {
                        "value": float(fit.values[k]), "std": float(fit.stds[k]), "unit": unit,
                        "budget": {source: float(share[k]) for source, share in fit.budget.items()},
                    }
                    for k, (name, unit) in enumerate(fit.law.parameters)
                },
                "log_covariance": fit.covariance.tolist(),
            }
            for fit in fits
        ],
        "remarks": remarks(fits),
    }  # fmt: skip
