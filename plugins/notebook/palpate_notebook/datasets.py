"""Samples and estimates as datasets of xarray: named dimensions, units in the attributes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from palpate import Samples
from palpate_kit.runs.run_folder import TrackTable

from palpate_notebook.optional_imports import library

if TYPE_CHECKING:
    import xarray

_SAMPLE_UNITS = {"force": "N", "position": "m", "velocity": "m/s"}
_ESTIMATE_UNITS = {"surface": "m", "surface_std": "m", "force": "N", "nis": "1", "innovation": "1"}
_TIME_ATTRIBUTES = {"units": "s", "long_name": "time since the first sample"}


def samples_dataset(samples: Samples) -> xarray.Dataset:
    """Return aligned samples over time [SI]."""
    columns: dict[str, Any] = {}
    for name, unit in _SAMPLE_UNITS.items():
        columns[name] = ("time", getattr(samples, name), {"units": unit})
    for i, name in enumerate(("x", "y")):
        columns[name] = ("time", samples.lateral[:, i], {"units": "m"})
    for name in ("contact", "active"):
        columns[name] = ("time", getattr(samples, name))
    dataset: xarray.Dataset = library("xarray").Dataset(columns, {"time": ("time", samples.time, _TIME_ATTRIBUTES)})
    return dataset


def estimates_dataset(tables: Mapping[str, TrackTable], document: Mapping[str, Any]) -> xarray.Dataset:
    """Return estimates by track over time [SI]; NaN where a track has no such parameter, or no estimate."""
    xr = library("xarray")
    datasets = [_track_dataset(name, table, document) for name, table in tables.items()]
    if not datasets:
        empty: xarray.Dataset = xr.Dataset()
        return empty
    joined: xarray.Dataset = xr.concat(
        datasets, dim="track", join="outer", data_vars="all", coords="minimal", compat="override"
    )
    # concat drops attributes that some track does not have.
    for dataset in datasets:
        for name, column in dataset.data_vars.items():
            joined[name].attrs.update(column.attrs)
    joined["time"].attrs.update(_TIME_ATTRIBUTES)
    return joined


def _track_dataset(name: str, table: TrackTable, document: Mapping[str, Any]) -> Any:
    """Return the estimates of one track over time [SI], with the dimension track of length 1."""
    parameters = document["tracks"].get(name, {}).get("parameters", {})
    columns: dict[str, Any] = {}
    for parameter, values in table.values.items():
        attributes = {"units": parameters.get(parameter, {}).get("unit", "1")}
        columns[parameter] = ("time", values, attributes)
        columns[f"{parameter}_std"] = ("time", table.std[parameter], attributes)
    for key, unit in _ESTIMATE_UNITS.items():
        if key in table.others:
            columns[key] = ("time", table.others[key], {"units": unit})
    columns["status"] = ("time", table.status)
    dataset = library("xarray").Dataset(columns, {"time": ("time", table.time, _TIME_ATTRIBUTES)})
    return dataset.expand_dims(track=[name])
