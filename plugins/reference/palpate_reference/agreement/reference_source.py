"""The value of a reference at the frequency and strain of a run, or why it has none there."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from palpate import ConfigurationError, Floats, to_si
from palpate_kit.numerics.normal_equations import linear_regression

from palpate_reference.agreement.value_pairs import ReferenceOf, ReferenceValue
from palpate_reference.material_table import MaterialTable, TableSettings
from palpate_reference.run_values import Conditions
from palpate_reference.table_reader import read_tables

QUANTITIES = {"elasticity": "Pa", "viscosity": "Pa*s"}
_STRAINS = 3.0  # ratio, above which strains are not called the same
_ROWS = 3  # that make a slope
_SECANT = 0.1  # strain up to which the slope of stress over strain is taken where a run's is not known


def stated_reference(text: str, uncertainty: str | None, unit: str, stated: Conditions) -> ReferenceOf:
    """One value with its standard uncertainty, and what is stated of how it was measured; raises ConfigurationError."""
    if uncertainty is None:
        raise ConfigurationError("--uncertainty is missing: the reference's standard uncertainty (k = 1), or '1 %'")
    try:
        value = to_si(text, unit)
        percent = uncertainty.strip().endswith("%")
        std = value * float(uncertainty.strip()[:-1]) / 100 if percent else to_si(uncertainty, unit)
    except ValueError as error:
        raise ConfigurationError(f"--reference, --uncertainty: {error}") from error
    if not (value > 0 and std > 0):
        raise ConfigurationError("--reference, --uncertainty: both are above zero")

    def reference(conditions: Conditions, _: float) -> ReferenceValue:
        return ReferenceValue("reference", value, std, tuple(differing(conditions, stated)))

    return reference


def differing(run: Conditions, stated: Conditions) -> list[str]:
    """By what a run and a reference differ, or what of it is not known."""
    found = []
    for name, here, there, unit, factor in (
        ("frequency", run.frequency, stated.frequency, "Hz", 1.0),
        ("strain", run.strain, stated.strain, "%", 100.0),
        ("speed", run.speed, stated.speed, "mm/s", 1e3),
    ):
        if there is None:
            continue
        if here is None:
            found.append(f"{name}: {factor * there:.3g} {unit} of the reference, of the run it is not known")
        elif max(here / there, there / here) > (1.02 if name == "frequency" else _STRAINS):
            found.append(f"{name}: {factor * here:.3g} {unit}, reference {factor * there:.3g} {unit}")
    if stated.frequency is None and stated.speed is None:
        found.append("frequency and speed of the reference are not stated (--frequency, --speed)")
    return found


def file_reference(
    path: Path, settings: TableSettings, quantity: str, uncertainty: str | None, stated: Conditions
) -> ReferenceOf:
    """Return a table of an instrument, read at the frequency of a run; raises UserError where it has no such value.

    A table over frequency gives E' and G''/(2 pi f); one of stress over strain gives the slope up to the run's strain.
    What a person states of how it was measured counts where the table does not say it.
    """
    tables = read_tables(path, settings)
    sweeps = [table for table in tables if table.kind == "oscillation"]
    presses = [table for table in tables if table.kind == "stress-strain" and quantity == "elasticity"]
    if not sweeps and not presses:
        kinds = ", ".join(table.kind for table in tables)
        raise ConfigurationError(
            f"{path}: has {kinds}, which gives no {quantity} at a frequency; fit a law (`palpate material fit`)"
        )
    share = _share(path, uncertainty, (sweeps or presses)[0])

    def reference(conditions: Conditions, poisson: float) -> ReferenceValue:
        if sweeps:
            return _at_frequency(sweeps[0], quantity, conditions, poisson, share, stated)
        return _slope(presses[0], conditions, poisson, share, stated)

    return reference


def _share(path: Path, uncertainty: str | None, table: MaterialTable) -> float:
    """Return the relative standard uncertainty that is stated of a table; raises ConfigurationError."""
    if uncertainty is None:
        if table.std is None:
            raise ConfigurationError(f"{path}: states no uncertainty: --uncertainty '2 %' states that of its scale")
        return 0.0
    try:
        share = float(uncertainty.strip().removesuffix("%")) / 100.0
    except ValueError as error:
        raise ConfigurationError(f"--uncertainty {uncertainty!r}: of a table in per cent, such as '2 %'") from error
    if not (uncertainty.strip().endswith("%") and 0 < share < 1):
        raise ConfigurationError(f"--uncertainty {uncertainty!r}: of a table in per cent, such as '2 %'")
    return share


def _at_frequency(
    table: MaterialTable, quantity: str, conditions: Conditions, poisson: float, share: float, stated: Conditions
) -> ReferenceValue:
    """E' or eta by interpolation of logarithms; raises ConfigurationError outside of the table."""
    frequency = conditions.frequency
    low, high = float(table.x.min()), float(table.x.max())
    if frequency is None:
        raise ConfigurationError(
            f"{table.name}: the run's motion is not one sine, so it has no frequency to compare at"
        )
    if not low / 1.001 <= frequency <= high * 1.001:
        raise ConfigurationError(
            f"{table.name}: goes from {low:.4g} to {high:.4g} Hz, and the run is at {frequency:.4g} Hz: not comparable "
            "(a law that is fitted, `palpate material fit`, can be carried on at your own risk)"
        )
    order = np.argsort(table.x)
    column = 0 if quantity == "elasticity" else 1

    def at(values: Floats) -> float:
        return float(np.exp(np.interp(math.log(frequency), np.log(table.x[order]), np.log(values[order]))))

    per = 2.0 * (1.0 + poisson) if table.shear else 1.0
    per = per if quantity == "elasticity" else per / (2.0 * (1.0 + poisson) * 2.0 * math.pi * frequency)
    value = per * at(table.y[:, column])
    std = share * value if table.std is None else math.hypot(share * value, per * at(table.std[:, column]))
    strain = stated.strain if table.strain is None else float(np.nanmedian(table.strain))
    there = Conditions(frequency, strain, stated.speed)
    return ReferenceValue(table.name, value, std, tuple(differing(conditions, there)))


def _slope(
    table: MaterialTable, conditions: Conditions, poisson: float, share: float, stated: Conditions
) -> ReferenceValue:
    """Young's modulus as the slope of stress over strain up to the strain of a run, with its standard error."""
    most = conditions.strain or _SECANT
    x, y = np.abs(table.x), np.abs(table.y[:, 0])
    within = x <= most
    count = int(within.sum())
    if count < _ROWS:
        raise ConfigurationError(
            f"{table.name}: has {count} rows up to a strain of {100 * most:.3g} %, fewer than {_ROWS}"
        )
    regression = linear_regression(np.column_stack([x[within], np.ones(count)]), y[within])
    slope, error = float(regression.weights[0]), float(regression.errors()[0])
    if not slope > 0.0:
        raise ConfigurationError(f"{table.name}: the stress does not rise up to a strain of {100 * most:.3g} %")
    per = 2.0 * (1.0 + poisson) if table.shear else 1.0
    about = "in shear" if table.shear else "taken as uniaxial: bonded specimens read more"
    return ReferenceValue(
        table.name, per * slope, per * math.hypot(error, share * slope),
        (f"slope of stress over strain up to {100 * most:.3g} %, {about}", *differing(conditions, stated)),
    )  # fmt: skip
