"""The sources of a fit of laws: tables of files, and runs of a sine as one line each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from palpate import ConfigurationError

from palpate_reference.material_table import MaterialTable, TableSettings
from palpate_reference.run_values import run_values
from palpate_reference.table_reader import read_tables


def read_sources(sources: Sequence[Path], settings: TableSettings, poisson: float) -> list[MaterialTable]:
    """Return tables of moduli and compliances, and one line for each run; else curves of stress over strain.

    Raises UserError, also where no law describes any of the tables, such as moduli at one frequency over strain.
    """
    tables: list[MaterialTable] = []
    for path in sources:
        tables += [_run_table(path, poisson)] if path.is_dir() else read_tables(path, settings)
    usable = [table for table in tables if _is_linear(table)]
    usable = usable or [table for table in tables if table.kind == "stress-strain"]
    if not usable:
        names = ", ".join(f"{table.name} ({table.kind})" for table in tables)
        raise ConfigurationError(
            f"{names}: no modulus over several frequencies or over time, so no law of time follows from it"
        )
    return usable


def _is_linear(table: MaterialTable) -> bool:
    """Return True for moduli over frequency or time, and compliances; not for a sweep of the strain."""
    if table.kind == "oscillation":
        return len(table.x) == 1 or table.sweeps_frequency
    return table.kind != "stress-strain"


def _run_table(path: Path, poisson: float) -> MaterialTable:
    """Return E' = E and E'' = 2 pi f 2 (1 + nu) eta of a palpation by a sine, as a table of one row."""
    elastic, viscous = run_values(path, ("elasticity", "viscosity"), None)
    frequency = elastic.conditions.frequency
    if frequency is None:
        raise ConfigurationError(
            f"{path}: its motion is not one sine, so that E and eta belong to no frequency; give the spectrum.csv or "
            "modulus.csv that `palpate fit spectrum` makes of it"
        )
    omega = 2.0 * math.pi * frequency  # [rad/s]
    loss, loss_std = (omega * 2.0 * (1.0 + poisson) * viscosity for viscosity in (viscous.value, viscous.std))
    return MaterialTable(
        path.name,
        elastic.track,
        format="run",
        kind="oscillation",
        shear=False,
        x=np.array([frequency]),
        y=np.array([[elastic.value, loss]]),
        std=np.array([[elastic.std, loss_std]]),
        strain=None,
        temperature=None,
    )
