"""What laws are fitted to: tables of files, and runs of a sine as one line each."""

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
    """Tables of moduli and compliances, and one line for each run; of files without any, curves of stress over strain.

    Raises UserError, also for what no law describes.
    """
    tables: list[MaterialTable] = []
    for path in sources:
        tables += [_line_of_run(path, poisson)] if path.is_dir() else read_tables(path, settings)
    linear = [one for one in tables if one.kind != "stress-strain"]
    linear = [one for one in linear if one.kind != "oscillation" or len(one.x) == 1 or one.sweeps_frequency]
    usable = linear or [one for one in tables if one.kind == "stress-strain"]
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
            "modulus.csv that `palpate fit spectrum` makes of it"
        )
    turn = 2.0 * math.pi * frequency
    y = np.array([[elastic.value, turn * 2.0 * (1.0 + poisson) * viscous.value]])
    std = np.array([[elastic.std, turn * 2.0 * (1.0 + poisson) * viscous.std]])
    return MaterialTable(
        path.name, elastic.track, "run", "oscillation", False, np.array([frequency]), y, std, None, None
    )
