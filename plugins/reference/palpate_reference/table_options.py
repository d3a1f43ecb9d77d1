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
ModulusOption = Annotated[
    Modulus | None, typer.Option("--modulus", help="What moduli are where no name says it: of shear or Young's.")
]


def table_settings(units: Sequence[str] | None, modulus: Modulus | None) -> TableSettings:
    """What the options state; raises ConfigurationError."""
    stated: dict[str, str] = {}
    for text in units or ():
        name, equals, unit = text.rpartition("=")
        if not (equals and name and unit):
            raise ConfigurationError(f'--unit {text!r}: write COLUMN=UNIT, such as --unit "Freq=rad/s"')
        stated[name.strip()] = unit.strip()
    return TableSettings(stated, None if modulus is None else modulus == "shear")
