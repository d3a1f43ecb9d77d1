"""The picture of the columns that were taken for force and motion, by which a person checks them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from palpate_kit.figures import figure_of, save_figure, style
from palpate_records.recording import Suggestion

_MAX_POINTS = 20_000  # of a curve, about: a choice, far more than the pixels of a picture


@style()
def draw_suggestion(suggestion: Suggestion, name: str, path: Path) -> None:
    """Draw each role over time, and the force over the position; raises ConfigurationError, OutputError."""
    figure, axes = figure_of(1, len(suggestion.views) + 1, height=35.0)  # [mm] of a panel: a choice
    # Each role over time since the first reading of any.
    first_time = min(float(time[0]) for time, _, _ in suggestion.views.values())
    for axis, (role, (time, values, unit)) in zip(axes[:, 0], suggestion.views.items(), strict=False):
        shown = _shown_readings(len(time))
        axis.plot(time[shown] - first_time, values[shown], linewidth=0.8)
        axis.set_ylabel(f"{role} [{unit}]")
    axes[0, 0].set_title(f"{name}: as palpate would read it")
    axes[-2, 0].set_xlabel("time [s]")
    # The force over the depth at the same instants.
    force_time, force, _ = suggestion.views["force"]
    position_time, position, _ = suggestion.views["position"]
    shown = _shown_readings(len(force_time))
    heights = np.interp(force_time[shown], position_time, position)
    axes[-1, 0].plot(1e3 * (heights.max() - heights), force[shown], ".", markersize=1)
    axes[-1, 0].set(xlabel="depth below the highest point [mm]", ylabel="force [N]")
    save_figure(figure, path)


def _shown_readings(count: int) -> slice:
    """Return the readings of a curve, of a count, that are drawn: all, or each of an even distance."""
    return slice(None, None, max(count // _MAX_POINTS, 1))
