"""Pictures of offline fits: force over time and over depth, and residuals."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Estimates, FitReport, Floats, Samples, UserError
from palpate.host import acceleration

_MOST = 20_000  # points in a curve


def draw(samples: Samples, found: Mapping[str, Estimates], tip_mass: float, folder: Path) -> list[Path]:
    """``force.png`` and ``residuals.png`` in a folder; none where nothing was fitted. Raises UserError."""
    fits = {name: (estimates, estimates.report) for name, estimates in found.items() if estimates.report is not None}
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
        for label, (estimates, report) in fits.items():
            force = _without_offset(contact, samples, estimates, report)
            paint(axes, label, samples, estimates, force)
        for axis in axes:
            axis.grid(True, alpha=0.3)
            axis.legend(fontsize=8)
        figure.savefig(folder / name, dpi=120, metadata={"Software": "palpate"})
        drawn.append(folder / name)
    return drawn


def _without_offset(force: Floats, samples: Samples, estimates: Estimates, report: FitReport) -> Floats:
    """Force (n,) [N] less the bias and drift of a fit."""
    time = samples.time[_rows(estimates)]
    middle = 0.5 * (time[0] + time[-1])
    return np.asarray(force - report.bias - report.drift * (samples.time - middle))


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
    name = f"{label}, {estimates.report.rss:.4g} N^2" if estimates.report else label
    axes[0].plot(samples.time[rows], left, linewidth=0.7, label=name)
    axes[1].plot(1e3 * (estimates.surface[rows] - samples.position[rows]), left, linewidth=0.7, label=name)
    axes[0].set(xlabel="time [s]", ylabel="model - measured [N]", title="residual over time")
    axes[1].set(xlabel="depth [mm]", ylabel="model - measured [N]", title="residual over depth")
