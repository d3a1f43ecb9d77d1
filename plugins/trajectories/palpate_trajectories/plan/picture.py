"""The picture of a motion before it is made."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate.host import figure_of


def plan_picture(
    time: Floats,
    position: Floats,
    velocity: Floats,
    measuring: NDArray[np.bool_],
    name: str,
) -> Any:
    """A motion before it is made: seen from above, height over time, speed over time."""
    figure, axes = figure_of(3, width=5.0, height=4.0)
    above, height, speed = axes[0]
    above.plot(*(1e3 * position[:, :2].T), linewidth=0.8, color="grey")
    above.plot(*(1e3 * position[measuring, :2].T), ".", markersize=1, color="tab:blue")
    above.set(xlabel="x [mm]", ylabel="y [mm]", title=name)
    above.axis("equal")
    height.plot(time, 1e3 * position[:, 2], linewidth=0.6, color="grey")
    height.plot(time[measuring], 1e3 * position[measuring, 2], ".", markersize=1, color="tab:blue")
    height.axhline(0.0, color="black", linewidth=0.5)
    height.set(xlabel="time [s]", ylabel="height [mm]", title="measuring in blue")
    speed.plot(time, 1e3 * np.linalg.norm(velocity, axis=1), linewidth=0.6)
    speed.set(xlabel="time [s]", ylabel="speed [mm/s]", title="speed")
    return figure
