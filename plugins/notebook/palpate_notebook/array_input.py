"""What people have in a notebook, as numbers in SI: arrays, pandas columns, pint quantities, xarray variables."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from palpate import ConfigurationError, Floats, to_si

_NANO = 1e9
_LARGEST = 9.2e9  # [s] that a time-stamp can hold


def numbers(name: str, given: ArrayLike, unit: str, written: str | None = None) -> Floats:
    """Return a column (n,) in the SI `unit`, from what a person has; `written` is the unit of plain numbers.

    Raises ConfigurationError for what is not a column of numbers, or of another dimension.
    """
    if hasattr(given, "magnitude") and hasattr(given, "to"):  # of pint
        if written is not None:
            raise ConfigurationError(
                f"{name}: carries its own unit, {getattr(given, 'units', '?')}: leave it out of units"
            )
        return numbers(name, _converted(name, given, unit), unit)
    attributes = getattr(given, "attrs", None)
    if written is None and isinstance(attributes, dict) and isinstance(attributes.get("units"), str):
        written = attributes["units"]
    try:
        column = np.asarray(given, float)
    except (TypeError, ValueError) as error:
        raise ConfigurationError(f"{name}: contains something that is not a number: {error}") from error
    if column.ndim != 1:
        shape = " x ".join(map(str, column.shape)) or "a single number"
        raise ConfigurationError(f"{name}: must be one column of numbers, not {shape}")
    if len(column) and np.isnan(column).all():
        raise ConfigurationError(f"{name}: holds no number: all {len(column)} readings are missing")
    return column * _scale(name, written, unit)


def _converted(name: str, given: Any, unit: str) -> Any:
    """Return the magnitudes of a pint quantity in the SI `unit`, by pint itself: it knows units that palpate does
    not."""
    try:
        return given.magnitude * (1.0 * given.units).to(unit).magnitude
    except Exception as error:  # of pint, for another dimension or an offset
        raise ConfigurationError(f"{name}: {error}") from error


def _scale(name: str, written: str | None, unit: str) -> float:
    if written is None:
        return 1.0
    try:
        return to_si(f"1 {written}", unit)
    except ValueError as error:
        raise ConfigurationError(f"{name}: {error}") from error


def stamps(given: ArrayLike, written: str | None = None) -> NDArray[np.int64]:
    """Time-stamps (n,) [ns] from seconds, or from dates; raises ConfigurationError where one is invalid."""
    if np.asarray(getattr(given, "magnitude", given)).dtype.kind == "M":
        dates = np.asarray(given).astype("datetime64[ns]")
        if np.isnat(dates).any():
            raise ConfigurationError(f"time: {int(np.isnat(dates).sum())} of its dates are missing")
        return np.asarray(dates.astype(np.int64))
    seconds = numbers("time", given, "s", written)
    odd = ~(np.isfinite(seconds) & (np.abs(seconds) < _LARGEST))
    if odd.any():
        row = int(np.flatnonzero(odd)[0])
        raise ConfigurationError(f"time: {int(odd.sum())} values are not times in seconds, the first one in row {row}")
    return np.rint(seconds * _NANO).astype(np.int64)
