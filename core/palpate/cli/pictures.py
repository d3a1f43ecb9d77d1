"""Pictures of offline fits: force over time and over depth, and residuals."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import UserError
from palpate.estimation import Estimates, Samples
from palpate.result import acceleration

Floats = NDArray[np.float64]

_MOST = 20_000  # points in a curve


def draw(samples: Samples, found: Mapping[str, Estimates], tip_mass: float, folder: Path) -> list[Path]:
    """``force.png`` and ``residuals.png`` in a folder; none where nothing was fitted. Raises UserError."""
    fits = {name: estimates for name, estimates in found.items() if estimates.details.get("fit")}
    if not fits:
        return []
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise UserError(
            "pictures need matplotlib: pip install matplotlib, or leave them out with --no-pictures"
        ) from error
    contact = samples.force + tip_mass * np.nan_to_num(acceleration(samples.time, samples.velocity))
    drawn = []
    for name, (columns, paint) in {"force.png": (2, _forces), "residuals.png": (2, _residuals)}.items():
        figure = Figure(figsize=(12, 4.5), layout="constrained")
        axes: Any = figure.subplots(1, columns)
        for label, estimates in fits.items():
            paint(axes, label, samples, estimates, _without_offset(contact, samples, estimates))
        for axis in axes:
            axis.grid(True, alpha=0.3)
            axis.legend(fontsize=8)
        figure.savefig(folder / name, dpi=120, metadata={"Software": "palpate"})
        drawn.append(folder / name)
    return drawn


def _without_offset(force: Floats, samples: Samples, estimates: Estimates) -> Floats:
    """Force (n,) [N] less the bias and slope of a fit."""
    known = estimates.details["unknowns"]
    time = samples.time[_rows(estimates)]
    middle = 0.5 * (time[0] + time[-1])
    return np.asarray(force - known["bias"]["value"] - known["slope"]["value"] * (samples.time - middle))


def _rows(estimates: Estimates) -> NDArray[np.intp]:
    """Fitted samples, at most some thousand of them."""
    rows = np.flatnonzero(estimates.status == 0)
    return rows[:: max(len(rows) // _MOST, 1)]


def _forces(axes: Any, label: str, samples: Samples, estimates: Estimates, force: Floats) -> None:
    rows = _rows(estimates)
    depth = 1e3 * (estimates.surface[rows] - samples.position[rows])
    if not axes[0].lines:
        axes[0].plot(samples.time[rows], force[rows], ".", markersize=1.5, color="0.6", label="measured")
        axes[1].plot(depth, force[rows], ".", markersize=1.5, color="0.6", label="measured")
        axes[0].set(xlabel="time [s]", ylabel="contact force [N]", title="force over time")
        axes[1].set(xlabel="depth [mm]", ylabel="contact force [N]", title="force over depth")
    axes[0].plot(samples.time[rows], estimates.force[rows], linewidth=1, label=label)
    axes[1].plot(depth, estimates.force[rows], linewidth=1, label=label)


def _residuals(axes: Any, label: str, samples: Samples, estimates: Estimates, force: Floats) -> None:
    rows = _rows(estimates)
    left = estimates.force[rows] - force[rows]
    name = f"{label}, {estimates.details['rss']:.4g} N^2"
    axes[0].plot(samples.time[rows], left, linewidth=0.7, label=name)
    axes[1].plot(1e3 * (estimates.surface[rows] - samples.position[rows]), left, linewidth=0.7, label=name)
    axes[0].set(xlabel="time [s]", ylabel="model - measured [N]", title="residual over time")
    axes[1].set(xlabel="depth [mm]", ylabel="model - measured [N]", title="residual over depth")


def draw_repeatability(document: Mapping[str, Any], path: Path) -> None:
    """Histogram, autocorrelation and moving average of every group, in one picture; raises UserError."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise UserError("--picture needs matplotlib: pip install matplotlib") from error
    from palpate.units import people

    word, factor = people(document["unit"])
    figure = Figure(figsize=(15, 4.5), layout="constrained")
    axes: Any = figure.subplots(1, 3)
    for name, found in document["groups"].items():
        axes[0].hist(factor * np.array(found["values"]), bins="auto", alpha=0.6, label=name)
        axes[1].plot(found["autocorrelation"], "o-", markersize=3, label=name)
        axes[1].axhline(found["autocorrelation_95"], linewidth=0.5, color="0.5")
        axes[2].plot(factor * np.array(found["moving_average"]), label=name)
    axes[0].set(xlabel=f"{document['parameter']} [{word}]", ylabel="count", title="histogram")
    axes[1].set(xlabel="lag", ylabel="autocorrelation", title="autocorrelation; line: 95 % of none")
    axes[2].set(xlabel="run", ylabel=f"{document['parameter']} [{word}]", title="moving average over 30")
    for axis in axes:
        axis.legend(fontsize=8)
    try:
        figure.savefig(path, dpi=120, metadata={"Software": "palpate"})
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: cannot draw there: {error}") from error
