"""What a run found as tables of pandas."""

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
        for parameter, found in values.items():
            unit, factor = (found["unit"], 1.0) if si else display_unit(found["unit"])
            numbers = {
                key: math.nan if found[key] is None else factor * found[key] for key in ("value", "std", "combined")
            }
            rows.append(
                {"track": name, "parameter": parameter, **numbers, "unit": unit, "verdict": found.get("verdict", "")}
            )
    columns = ["track", "parameter", "value", "std", "combined", "unit", "verdict"]
    return library("pandas").DataFrame(rows, columns=columns).set_index(["track", "parameter"])


def fit_frame(samples: Samples, measured: Floats, modelled: Floats) -> pandas.DataFrame:
    """Return a row for each sample: the motion, the sensor's force, contact force as measured and modelled, residual
    [SI]."""
    columns = {name: getattr(samples, name) for name in ("position", "velocity", "contact", "force")}
    columns |= {"contact_force": measured, "model": modelled, "residual": measured - modelled}
    pandas = library("pandas")
    return pandas.DataFrame(columns, index=pandas.Index(samples.time, name="time"))


def budget_frame(track: Mapping[str, Any]) -> pandas.DataFrame:
    """Return a row for each source: its standard uncertainty, and what it gives each value [SI]; combined comes
    last."""
    names = list(track["parameters"])
    rows = [
        {"source": row["source"], "u": row["std"], "unit": row["unit"]}
        | {name: (row["effects"].get(name) or {}).get("contribution") for name in names}
        for row in track.get("budget", ())
    ]
    combined = {name: track["parameters"][name]["combined"] for name in names}
    rows.append({"source": "combined", "u": None, "unit": "", **combined})
    pandas = library("pandas")
    frame = pandas.DataFrame(rows, columns=["source", "u", "unit", *names]).set_index("source")
    return frame.astype(dict.fromkeys(["u", *names], float))


def correlation_frame(track: Mapping[str, Any]) -> pandas.DataFrame:
    """Correlation matrix of what a fit looked for."""
    fit = track.get("fit") or {"unknowns": {}, "correlations": []}
    names = [name for name, unknown in fit["unknowns"].items() if unknown["free"]]
    frame = library("pandas").DataFrame(math.nan, index=names, columns=names)
    for name in names:
        frame.loc[name, name] = 1.0
    for pair in fit["correlations"]:
        if pair["first"] in names and pair["second"] in names:
            frame.loc[pair["first"], pair["second"]] = frame.loc[pair["second"], pair["first"]] = pair["value"]
    return frame
