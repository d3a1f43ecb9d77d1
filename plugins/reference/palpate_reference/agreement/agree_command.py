"""``palpate material agree``: how well palpation agrees with a reference instrument, and how well with itself."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal

import typer
from palpate import ConfigurationError, to_si
from palpate_engine import make_folder, write_new, write_whole
from palpate_kit.terminal.json_output import json_text, print_aside, print_json
from palpate_kit.terminal.options import FolderOption, FormatOption, JsonOption, TrackOption

from palpate_reference.agreement.agreement import Agreement, agreement_of
from palpate_reference.agreement.agreement_report import document, pair_document, show_agreement
from palpate_reference.agreement.reference_source import QUANTITIES, file_reference, stated_reference
from palpate_reference.agreement.value_pairs import ReferenceOf, ValuePair, run_pairs, table_pairs
from palpate_reference.material_table import TableSettings
from palpate_reference.run_values import Conditions
from palpate_reference.table_options import ColumnOption, ModulusOption, UnitOption, table_settings

AGREEMENT = "agreement.json"
Quantity = Literal["elasticity", "viscosity"]


def agree(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN...", help="Run folders on one specimen; or a CSV of many specimens and references."
        ),
    ],
    reference: Annotated[
        str | None,
        typer.Option(metavar="FILE|VALUE", help="A table of a rheometer, DMA or dynamometer; or '112.5 kPa'."),
    ] = None,
    uncertainty: Annotated[
        str | None,
        typer.Option(metavar="VALUE", help="Standard uncertainty of the reference (k = 1); of a table in %."),
    ] = None,
    quantity: Annotated[Quantity, typer.Option(help="What is compared.")] = "elasticity",
    frequency: Annotated[str | None, typer.Option(help="At which a reference value was measured, '2 Hz'.")] = None,
    strain: Annotated[str | None, typer.Option(help="To which it was deformed, '10 %'.")] = None,
    speed: Annotated[str | None, typer.Option(help="At which it was deformed, '50 mm/min'.")] = None,
    track: TrackOption = None,
    units: UnitOption = None,
    modulus: ModulusOption = None,
    columns: ColumnOption = None,
    out: FolderOption = None,
    as_json: JsonOption = False,
    layout: FormatOption = "table",
) -> None:
    """Compare palpation with a reference instrument at the same frequency, strain and speed, or say why not.

    E_n of each run (ISO 13528), Bland and Altman's limits of agreement and Deming's line over specimens, repeatability
    and reproducibility (ISO 5725), ICC and the smallest detectable change. The report of each run shows the result.
    """
    stated = Conditions(_stated(frequency, "Hz"), _percent(strain), _stated(speed, "m/s"))
    if len(runs) == 1 and runs[0].is_file():
        pairs = _table_pairs(runs[0], quantity, track, reference)
    else:
        settings = table_settings(units, modulus, columns)
        reference_of = _reference(reference, uncertainty, quantity, stated, settings)
        pairs = run_pairs(runs, quantity, track, reference_of)
    agreement = agreement_of(pairs, quantity)
    folder = make_folder("agreement", out, datetime.now(UTC).astimezone())
    _write(agreement, folder)
    if as_json:
        print_json({"folder": folder, **document(agreement)})
        return
    with print_aside(False):
        show_agreement(agreement)
    typer.echo(f"written to {folder}: {AGREEMENT}, agreement.png", err=layout != "table")


def _table_pairs(path: Path, quantity: Quantity, track: str | None, reference: str | None) -> Sequence[ValuePair]:
    """Return the pairs of a table, which has its own references; raises UserError."""
    if reference is not None:
        raise ConfigurationError(f"{path}: the table has its own references: leave --reference out")
    return table_pairs(path, quantity, QUANTITIES[quantity], track)


def _stated(text: str | None, unit: str) -> float | None:
    """Return a stated quantity [SI]; None for none."""
    try:
        return None if text is None else to_si(text, unit)
    except ValueError as error:
        raise ConfigurationError(f"--frequency, --speed: {error}") from error


def _percent(text: str | None) -> float | None:
    """Return a share that is written in per cent; None for none."""
    if text is None:
        return None
    try:
        if not text.strip().endswith("%"):
            raise ValueError(text)
        return float(text.strip()[:-1]) / 100.0
    except ValueError as error:
        raise ConfigurationError(f"--strain {text!r}: in per cent, such as '10 %'") from error


def _reference(
    text: str | None, uncertainty: str | None, quantity: Quantity, stated: Conditions, settings: TableSettings
) -> ReferenceOf:
    """Return a stated value where the text begins as a number, and is not a file; else the table in a file."""
    if text is None:
        raise ConfigurationError('--reference is missing: "112.5 kPa" with --uncertainty, or a table of an instrument')
    path = Path(text)
    if path.is_file() or not text.strip()[:1].isdigit():
        return file_reference(path, settings, quantity, uncertainty, stated)
    return stated_reference(text, uncertainty, QUANTITIES[quantity], stated)


def _write(agreement: Agreement, folder: Path) -> None:
    """Write the document and the picture to a folder, and to each run its own pair."""
    from palpate_reference.agreement.agreement_figure import draw_agreement

    write_new(folder / AGREEMENT, json_text(document(agreement)))
    draw_agreement(agreement.pairs, agreement.limits, agreement.line, agreement.quantity, folder / "agreement.png")
    for pair in agreement.pairs:
        if pair.run is not None:
            run_document = {"quantity": agreement.quantity, "unit": agreement.unit, **pair_document(pair)}
            write_whole(pair.run / AGREEMENT, json_text(run_document))
