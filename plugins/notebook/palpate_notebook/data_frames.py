"""Results of a run as tables of pandas."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from palpate import Floats, Samples
from palpate_engine import display_unit

from palpate_notebook.optional_imports import library

if TYPE_CHECKING:
    import pandas


def summary_frame(document: Mapping[str, Any], si: bool) -> pandas.DataFrame:
    """Return a row for each track and parameter, in display units or in SI."""
    rows = []
    for name, track in document["tracks"].items():
        values = {**track["parameters"], **track.get("derived", {}), "surface": track["surface"]}
        for parameter, entry in values.items():
            unit, factor = (entry["unit"], 1.0) if si else display_unit(entry["unit"])
            row = {"track": name, "parameter": parameter, "unit": unit, "verdict": entry.get("verdict", "")}
            for key in ("value", "std", "combined"):
                row[key] = math.nan if entry[key] is None else factor * entry[key]
            rows.append(row)
    columns = ["track", "parameter", "value", "std", "combined", "unit", "verdict"]
    return library("pandas").DataFrame(rows, columns=columns).set_index(["track", "parameter"])


def fit_frame(samples: Samples, measured: Floats, modelled: Floats) -> pandas.DataFrame:
    """Return a row for each sample [SI]: motion, force of the sensor, contact force, the model's, and the residual.

    `measured` and `modelled`: contact force (n,) [N].
    """
    columns = {name: getattr(samples, name) for name in ("position", "velocity", "contact", "force")}
    columns |= {"contact_force": measured, "model": modelled, "residual": measured - modelled}
    pandas = library("pandas")
    return pandas.DataFrame(columns, index=pandas.Index(samples.time, name="time"))


def budget_frame(track: Mapping[str, Any]) -> pandas.DataFrame:
    """Return a row for each source of uncertainty of a track's table in result.json, the combined one last.

    Columns: standard uncertainty `u` of the source and its unit, then its contribution to each value [SI].
    """
    names = list(track["parameters"])
    rows = []
    for entry in track.get("budget", ()):
        row = {"source": entry["source"], "u": entry["std"], "unit": entry["unit"]}
        for name in names:
            row[name] = (entry["effects"].get(name) or {}).get("contribution")
        rows.append(row)
    combined = {name: track["parameters"][name]["combined"] for name in names}
    rows.append({"source": "combined", "u": None, "unit": "", **combined})
    pandas = library("pandas")
    frame = pandas.DataFrame(rows, columns=["source", "u", "unit", *names]).set_index("source")
    return frame.astype(dict.fromkeys(["u", *names], float))


def correlation_frame(track: Mapping[str, Any]) -> pandas.DataFrame:
    """Return the correlation matrix of the free unknowns of a fit, from a track's table in result.json; else NaN."""
    fit = track.get("fit") or {"unknowns": {}, "correlations": []}
    names = [name for name, unknown in fit["unknowns"].items() if unknown["free"]]
    frame = library("pandas").DataFrame(math.nan, index=names, columns=names)
    for name in names:
        frame.loc[name, name] = 1.0
    for pair in fit["correlations"]:
        if pair["first"] in names and pair["second"] in names:
            frame.loc[pair["first"], pair["second"]] = frame.loc[pair["second"], pair["first"]] = pair["value"]
    return frame
