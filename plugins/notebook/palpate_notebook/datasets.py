"""Samples and estimates as xarray: named dimensions, and the unit of everything in its attributes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from palpate import Samples
from palpate_kit.runs.run_folder import TrackTable

from palpate_notebook.optional_imports import library

if TYPE_CHECKING:
    import xarray

_SAMPLES = {"force": "N", "position": "m", "velocity": "m/s"}
_OTHERS = {"surface": "m", "surface_std": "m", "force": "N", "nis": "1", "innovation": "1"}
_TIME = {"units": "s", "long_name": "time since the first sample"}


def samples_dataset(samples: Samples) -> xarray.Dataset:
    """Aligned samples over time [SI]."""
    columns: dict[str, Any] = {
        name: ("time", getattr(samples, name), {"units": unit}) for name, unit in _SAMPLES.items()
    }
    columns |= {name: ("time", samples.lateral[:, i], {"units": "m"}) for i, name in enumerate("xy")}
    columns |= {name: ("time", getattr(samples, name)) for name in ("contact", "active")}
    found: xarray.Dataset = library("xarray").Dataset(columns, {"time": ("time", samples.time, _TIME)})
    return found


def estimates_dataset(tables: Mapping[str, TrackTable], document: Mapping[str, Any]) -> xarray.Dataset:
    """Estimates by track over time [SI]; NaN where a track has no such parameter, or no estimate."""
    known = library("xarray")
    single = [_of_track(known, name, table, document) for name, table in tables.items()]
    if not single:
        empty: xarray.Dataset = known.Dataset()
        return empty
    joined: xarray.Dataset = known.concat(
        single, dim="track", join="outer", data_vars="all", coords="minimal", compat="override"
    )
    for found in single:  # concat drops what not every one of them has
        for name, column in found.data_vars.items():
            joined[name].attrs.update(column.attrs)
    joined["time"].attrs.update(_TIME)
    return joined


def _of_track(known: Any, name: str, table: TrackTable, document: Mapping[str, Any]) -> Any:
    parameters = document["tracks"].get(name, {}).get("parameters", {})
    columns: dict[str, Any] = {}
    for parameter, values in table.values.items():
        unit = {"units": parameters.get(parameter, {}).get("unit", "1")}
        columns[parameter] = ("time", values, unit)
        columns[f"{parameter}_std"] = ("time", table.std[parameter], unit)
    columns |= {
        key: ("time", table.others[key], {"units": unit}) for key, unit in _OTHERS.items() if key in table.others
    }
    columns["status"] = ("time", table.status)
    found = known.Dataset(columns, {"time": ("time", table.time, _TIME)})
    return found.expand_dims(track=[name])
