"""The value of a reference at the frequency and strain of a run, or the reason why it has none there."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from palpate import ConfigurationError, Floats, to_si
from palpate_kit.numerics.normal_equations import linear_regression

from palpate_reference.agreement.value_pairs import ReferenceOf, ReferenceValue
from palpate_reference.fit_problem import shear_factor
from palpate_reference.material_table import MaterialTable, TableSettings
from palpate_reference.run_values import Conditions
from palpate_reference.table_reader import read_tables

QUANTITIES = {"elasticity": "Pa", "viscosity": "Pa*s"}
# Choices: a frequency is that of an instrument's setting, a strain or a speed differs over the specimen.
_MAX_FREQUENCY_RATIO = 1.02  # above which frequencies are not called the same
_MAX_CONDITION_RATIO = 3.0  # the same of strains and speeds
_MIN_ROWS = 3  # of a slope with an uncertainty
_DEFAULT_STRAIN = 0.1  # up to which the slope of stress over strain is taken where a run's strain is not known
_END_TOLERANCE = 1.001  # factor by which a frequency may be beyond the ends of a table: rounding


def stated_reference(text: str, uncertainty: str | None, unit: str, stated: Conditions) -> ReferenceOf:
    """Return one value with its standard uncertainty, measured at the stated conditions; raises ConfigurationError."""
    if uncertainty is None:
        raise ConfigurationError("--uncertainty is missing: the reference's standard uncertainty (k = 1), or '1 %'")
    try:
        value = to_si(text, unit)
        is_percent = uncertainty.strip().endswith("%")
        std = value * float(uncertainty.strip()[:-1]) / 100 if is_percent else to_si(uncertainty, unit)
    except ValueError as error:
        raise ConfigurationError(f"--reference, --uncertainty: {error}") from error
    if not (value > 0 and std > 0):
        raise ConfigurationError("--reference, --uncertainty: both are above zero")

    def reference(conditions: Conditions, _: float) -> ReferenceValue:
        return ReferenceValue("reference", value, std, tuple(differing(conditions, stated)))

    return reference


def differing(run: Conditions, stated: Conditions) -> list[str]:
    """Return remarks on the conditions by which a run and a reference differ, or which are not known of the run."""
    remarks = []
    for name, unit, factor, max_ratio in (
        ("frequency", "Hz", 1.0, _MAX_FREQUENCY_RATIO),
        ("strain", "%", 100.0, _MAX_CONDITION_RATIO),
        ("speed", "mm/s", 1e3, _MAX_CONDITION_RATIO),
    ):
        run_condition, reference_condition = getattr(run, name), getattr(stated, name)
        if reference_condition is None:
            continue
        shown_reference = f"{factor * reference_condition:.3g} {unit}"
        if run_condition is None:
            remarks.append(f"{name}: {shown_reference} of the reference, of the run it is not known")
        elif max(run_condition / reference_condition, reference_condition / run_condition) > max_ratio:
            remarks.append(f"{name}: {factor * run_condition:.3g} {unit}, reference {shown_reference}")
    if stated.frequency is None and stated.speed is None:
        remarks.append("frequency and speed of the reference are not stated (--frequency, --speed)")
    return remarks


def file_reference(
    path: Path, settings: TableSettings, quantity: str, uncertainty: str | None, stated: Conditions
) -> ReferenceOf:
    """Return a table of an instrument, read at the frequency of a run; raises UserError where it has no such value.

    A table over frequency gives E' and G''/(2 pi f); one of stress over strain gives the slope up to the run's strain.
    The conditions that a person states count where the table does not have them.
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
    """Return the relative standard uncertainty that is stated of a table; raises ConfigurationError.

    0 where none is stated, and the table has its own.
    """
    if uncertainty is None:
        if table.std is None:
            raise ConfigurationError(f"{path}: states no uncertainty: --uncertainty '2 %' states that of its scale")
        return 0.0
    remedy = f"--uncertainty {uncertainty!r}: of a table in per cent, such as '2 %'"
    try:
        share = float(uncertainty.strip().removesuffix("%")) / 100.0
    except ValueError as error:
        raise ConfigurationError(remedy) from error
    if not (uncertainty.strip().endswith("%") and 0 < share < 1):
        raise ConfigurationError(remedy)
    return share


def _at_frequency(
    table: MaterialTable, quantity: str, conditions: Conditions, poisson: float, share: float, stated: Conditions
) -> ReferenceValue:
    """Return E' or eta = E''/(2 (1 + nu) omega) at the frequency of a run, by interpolation of logarithms.

    The uncertainty has a relative part `share`, and the table's own. Raises ConfigurationError outside of the table.
    """
    frequency = conditions.frequency
    low, high = float(table.x.min()), float(table.x.max())
    if frequency is None:
        raise ConfigurationError(
            f"{table.name}: the run's motion is not one sine, so it has no frequency to compare at"
        )
    if not low / _END_TOLERANCE <= frequency <= high * _END_TOLERANCE:
        raise ConfigurationError(
            f"{table.name}: goes from {low:.4g} to {high:.4g} Hz, and the run is at {frequency:.4g} Hz: not comparable "
            "(a law that is fitted, `palpate material fit`, can be carried on at your own risk)"
        )
    order = np.argsort(table.x)

    def interpolated(values: Floats) -> float:
        return float(np.exp(np.interp(math.log(frequency), np.log(table.x[order]), np.log(values[order]))))

    # From the modulus of the table to the quantity.
    column, factor = 0, shear_factor(table, poisson)
    if quantity == "viscosity":
        column, factor = 1, factor / (2.0 * (1.0 + poisson) * 2.0 * math.pi * frequency)
    value = factor * interpolated(table.y[:, column])
    std = share * value
    if table.std is not None:
        std = math.hypot(std, factor * interpolated(table.std[:, column]))
    strain = stated.strain if table.strain is None else float(np.nanmedian(table.strain))
    reference_conditions = Conditions(frequency, strain, stated.speed)
    return ReferenceValue(table.name, value, std, tuple(differing(conditions, reference_conditions)))


def _slope(
    table: MaterialTable, conditions: Conditions, poisson: float, share: float, stated: Conditions
) -> ReferenceValue:
    """Return Young's modulus as the slope of stress over strain up to the strain of a run.

    The uncertainty is the standard error of the slope, and a relative part `share`.
    """
    max_strain = conditions.strain or _DEFAULT_STRAIN
    strain, stress = np.abs(table.x), np.abs(table.y[:, 0])
    is_within = strain <= max_strain
    count = int(is_within.sum())
    if count < _MIN_ROWS:
        raise ConfigurationError(
            f"{table.name}: has {count} rows up to a strain of {100 * max_strain:.3g} %, fewer than {_MIN_ROWS}"
        )
    line = linear_regression(np.column_stack([strain[is_within], np.ones(count)]), stress[is_within])
    slope, slope_std = float(line.weights[0]), float(line.errors()[0])
    if not slope > 0.0:
        raise ConfigurationError(f"{table.name}: the stress does not rise up to a strain of {100 * max_strain:.3g} %")
    factor = shear_factor(table, poisson)
    assumption = "in shear" if table.shear else "taken as uniaxial: bonded specimens read more"
    remark = f"slope of stress over strain up to {100 * max_strain:.3g} %, {assumption}"
    return ReferenceValue(
        table.name,
        value=factor * slope,
        std=factor * math.hypot(slope_std, share * slope),
        remarks=(remark, *differing(conditions, stated)),
    )
