"""What was taken for force and motion, as a picture, by which a person sees whether it is so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from palpate_kit.figures import figure_of, save_figure, style
from palpate_records.recording import Suggestion

_POINTS = 20_000  # of each curve


@style()
def draw_suggestion(suggestion: Suggestion, name: str, path: Path) -> None:
    """Draw each role over time, and the force over the position; raises ConfigurationError, OutputError."""
    figure, axes = figure_of(1, len(suggestion.views) + 1, height=35.0)
    begin = min(float(time[0]) for time, _, _ in suggestion.views.values())
    for axis, (role, (time, values, unit)) in zip(axes[:, 0], suggestion.views.items(), strict=False):
        every = max(len(time) // _POINTS, 1)
        axis.plot(time[::every] - begin, values[::every], linewidth=0.8)
        axis.set_ylabel(f"{role} [{unit}]")
    axes[0, 0].set_title(f"{name}: as palpate would read it")
    axes[-2, 0].set_xlabel("time [s]")
    force, place = suggestion.views["force"], suggestion.views["position"]
    every = max(len(force[0]) // _POINTS, 1)
    heights = np.interp(force[0][::every], place[0], place[1])
    axes[-1, 0].plot(1e3 * (heights.max() - heights), force[1][::every], ".", markersize=1)
    axes[-1, 0].set(xlabel="depth below the highest point [mm]", ylabel="force [N]")
    save_figure(figure, path)
