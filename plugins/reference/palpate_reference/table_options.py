"""Options by which a person states what a table does not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import typer
from palpate import ConfigurationError

from palpate_reference.material_table import TableSettings

Modulus = Literal["shear", "young"]
UnitOption = Annotated[
    list[str] | None,
    typer.Option("--unit", metavar="COLUMN=UNIT", help="Unit of a column that states none; can be repeated."),
]
ColumnOption = Annotated[
    list[str] | None,
    typer.Option(
        "--column",
        metavar="ROLE=COLUMN",
        help='Which column is what where its name does not say it, as in "storage=My modulus"; can be repeated.',
    ),
]
ModulusOption = Annotated[
    Modulus | None, typer.Option("--modulus", help="What moduli are where no name says it: of shear or Young's.")
]


def table_settings(
    units: Sequence[str] | None, modulus: Modulus | None, columns: Sequence[str] | None = None
) -> TableSettings:
    """Return the statements of the options; raises ConfigurationError."""
    unit_of_column = dict(_pair(text, "--unit", "COLUMN=UNIT", "Freq=rad/s", at_last=True) for text in units or ())
    column_of_role = dict(_pair(text, "--column", "ROLE=COLUMN", "storage=My modulus") for text in columns or ())
    return TableSettings(unit_of_column, None if modulus is None else modulus == "shear", column_of_role)


def _pair(text: str, option: str, form: str, example: str, at_last: bool = False) -> tuple[str, str]:
    """Return the texts before and behind the first sign of equality, or the last one; raises ConfigurationError."""
    key, equals, value = text.rpartition("=") if at_last else text.partition("=")
    if not (equals and key and value):
        raise ConfigurationError(f'{option} {text!r}: write {form}, such as {option} "{example}"')
    return key.strip(), value.strip()
