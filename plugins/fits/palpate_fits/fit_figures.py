"""Pictures of offline fits: force over time and over depth, and residuals."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Estimates, FitReport, Floats, Samples
from palpate_engine import acceleration
from palpate_kit.figures import figure_of, label_forces, legend_outside, quartiles, save_figure, style

_MAX_POINTS = 20_000  # in a curve (choice)


@style()
def draw(
    samples: Samples, estimates_by_track: Mapping[str, Estimates], tip_mass: float, folder: Path, ending: str = "png"
) -> list[Path]:
    """Draw ``force.png`` and ``residuals.png`` in a folder; none where nothing was fitted. Raises UserError."""
    fits = {
        name: (estimates, estimates.report)
        for name, estimates in estimates_by_track.items()
        if estimates.report is not None
    }
    if not fits:
        return []
    # The force of the contact [N]: the measured one without the tip's inertia.
    contact_force = samples.force + tip_mass * np.nan_to_num(acceleration(samples.time, samples.velocity))
    drawn = []
    for name, paint in {"force": _forces, "residuals": _residuals}.items():
        # Two axes, over time and over depth.
        figure, rows_of_axes = figure_of(columns=2)
        axes = rows_of_axes[0]  # of one row
        for label, (estimates, report) in fits.items():
            force = _without_offset(contact_force, samples, estimates, report)
            paint(axes, label, samples, estimates, force)
        for axis in axes:
            legend_outside(axis, columns=2)
        drawn.append(folder / f"{name}.{ending}")
        save_figure(figure, drawn[-1])
    return drawn


def _without_offset(force: Floats, samples: Samples, estimates: Estimates, report: FitReport) -> Floats:
    """Return the force (n,) [N] less the bias and drift of a fit."""
    time = samples.time[_rows(estimates)]
    middle = 0.5 * (time[0] + time[-1])  # from which a fit counts its drift
    return np.asarray(force - report.bias - report.drift * (samples.time - middle))


def _rows(estimates: Estimates) -> NDArray[np.intp]:
    """Return the fitted samples, at most some thousand of them."""
    rows = np.flatnonzero(estimates.status == 0)
    return rows[:: max(len(rows) // _MAX_POINTS, 1)]


def _forces(axes: Any, label: str, samples: Samples, estimates: Estimates, force: Floats) -> None:
    """Draw the force over time and over depth: as measured, and by the fit."""
    rows = _rows(estimates)
    depth = 1e3 * (estimates.surface[rows] - samples.position[rows])
    for axis, across, heading in ((axes[0], samples.time[rows], "time [s]"), (axes[1], depth, "depth [mm]")):
        if not axis.lines:
            axis.plot(across, force[rows], ".", markersize=1, color="0.6", label="measured")
            axis.set_prop_cycle(None)
            axis.set(xlabel=heading, ylabel="contact force [N]")
        axis.plot(across, estimates.force[rows], linewidth=0.8, label=label)  # thin: the fit lies on the readings


def _residuals(axes: Any, label: str, samples: Samples, estimates: Estimates, force: Floats) -> None:
    """Draw residuals over time; over depth by median and quartiles in 40 bins, since loops cross each other."""
    rows = _rows(estimates)
    residual = estimates.force[rows] - force[rows]
    name = f"{label}, {estimates.report.rss:.4g} N²" if estimates.report else label
    axes[0].plot(samples.time[rows], residual, linewidth=0.5, label=name)
    depth, (low, middle, high) = quartiles(1e3 * (estimates.surface[rows] - samples.position[rows]), residual)
    (line,) = axes[1].plot(depth, middle, label=label)
    axes[1].fill_between(depth, low, high, color=line.get_color(), alpha=0.2, linewidth=0)
    for axis, across in zip(axes, ("time [s]", "depth [mm]"), strict=True):
        axis.set(xlabel=across)
        label_forces(axis, "model less measured")
