"""Columns of numbers in SI, from arrays, pandas columns, pint quantities and xarray variables."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from palpate import ConfigurationError, Floats, to_si

_SECOND = 1e9  # [ns]
_MAX_TIME = 9.2e9  # [s]; a time-stamp of 64 bits holds 9.22e18 ns


def numbers(name: str, data: ArrayLike, unit: str, data_unit: str | None = None) -> Floats:
    """Return a column (n,) in the SI `unit`; `data_unit` is that of plain numbers, None: of its attributes, or SI.

    Raises ConfigurationError for what is not a column of numbers, or of another dimension.
    """
    if hasattr(data, "magnitude") and hasattr(data, "to"):  # a quantity of pint
        if data_unit is not None:
            raise ConfigurationError(
                f"{name}: carries its own unit, {getattr(data, 'units', '?')}: leave it out of units"
            )
        return numbers(name, _pint_magnitudes(name, data, unit), unit)
    attributes = getattr(data, "attrs", None)  # of xarray and pandas
    if data_unit is None and isinstance(attributes, dict) and isinstance(attributes.get("units"), str):
        data_unit = attributes["units"]
    try:
        column = np.asarray(data, float)
    except (TypeError, ValueError) as error:
        raise ConfigurationError(f"{name}: contains something that is not a number: {error}") from error
    if column.ndim != 1:
        shape = " x ".join(map(str, column.shape)) or "a single number"
        raise ConfigurationError(f"{name}: must be one column of numbers, not {shape}")
    if len(column) and np.isnan(column).all():
        raise ConfigurationError(f"{name}: holds no number: all {len(column)} readings are missing")
    return column * _si_factor(name, data_unit, unit)


def _pint_magnitudes(name: str, quantity: Any, unit: str) -> Any:
    """Return the magnitudes of a pint quantity in the SI `unit`, by pint, which has more units than palpate."""
    try:
        return quantity.magnitude * (1.0 * quantity.units).to(unit).magnitude
    except Exception as error:  # of pint, for another dimension or an offset
        raise ConfigurationError(f"{name}: {error}") from error


def _si_factor(name: str, data_unit: str | None, unit: str) -> float:
    """Return how many of the SI `unit` one `data_unit` is; raises ConfigurationError for another dimension."""
    if data_unit is None:
        return 1.0
    try:
        return to_si(f"1 {data_unit}", unit)
    except ValueError as error:
        raise ConfigurationError(f"{name}: {error}") from error


def stamps(data: ArrayLike, data_unit: str | None = None) -> NDArray[np.int64]:
    """Return time-stamps (n,) [ns] from seconds, or from dates; raises ConfigurationError where one is invalid."""
    if np.asarray(getattr(data, "magnitude", data)).dtype.kind == "M":  # dates
        dates = np.asarray(data).astype("datetime64[ns]")
        if np.isnat(dates).any():
            raise ConfigurationError(f"time: {int(np.isnat(dates).sum())} of its dates are missing")
        return np.asarray(dates.astype(np.int64))
    seconds = numbers("time", data, "s", data_unit)
    is_invalid = ~(np.isfinite(seconds) & (np.abs(seconds) < _MAX_TIME))
    if is_invalid.any():
        row = int(np.flatnonzero(is_invalid)[0])
        raise ConfigurationError(
            f"time: {int(is_invalid.sum())} values are not times in seconds, the first one in row {row}"
        )
    return np.rint(seconds * _SECOND).astype(np.int64)
