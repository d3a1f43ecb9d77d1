"""The picture of a press: force and fit, where contact begins, the modulus over depth, the way out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from palpate_engine import display_unit
from palpate_kit.figures import common_limits, figure_of, force_unit, legend_outside, save_figure, style

from palpate_indentation.press_analysis import Indentation

_MOST = 4000  # points of a curve


@style()
def draw(found: Indentation, path: Path) -> None:
    """Four panels, or three where there was no way out; raises OutputError."""
    figure, panels = figure_of(2, 2)
    axes = panels.ravel()
    length, scale = ("mm", 1e3) if found.depth > 1e-4 else ("um", 1e6)
    force, per_force = force_unit(float(np.ptp(found.branch.force)))
    thin = slice(None, None, max(len(found.branch) // _MOST, 1))
    fit, branch = found.fit, found.branch
    depth = scale * (fit.surface - branch.height[thin])
    axes[0].plot(depth, per_force * branch.force[thin], ".", markersize=1.5, color="0.6", label="measured")
    axes[0].plot(depth, per_force * (branch.force - fit.residual)[thin], color="C0", label="fit")
    axes[0].set(xlabel=f"depth [{length}]", ylabel=f"force [{force}]")
    legend_outside(axes[0])
    _contact(axes[1], found, scale, per_force, thin)
    axes[1].set(xlabel=f"depth [{length}]", ylabel=f"force [{force}]")
    _modulus(axes[2], found, scale)
    axes[2].set(xlabel=f"depth [{length}]")
    if found.press.retract is not None:
        out = found.press.retract
        every = slice(None, None, max(len(out) // _MOST, 1))
        axes[3].plot(depth, per_force * branch.force[thin], linewidth=0.8, color="0.7", label="in")
        axes[3].plot(scale * (fit.surface - out.height[every]), per_force * out.force[every], label="out")
        axes[3].set(xlabel=f"depth [{length}]", ylabel=f"force [{force}]")
        legend_outside(axes[3])
    else:
        axes[3].axis("off")
    save_figure(figure, path)


def _contact(axis: Any, found: Indentation, scale: float, per_force: float, thin: slice) -> None:
    """Around the contact point, with every method's."""
    fit, branch = found.fit, found.branch
    reach = 0.15 * found.depth
    depth = fit.surface - branch.height[thin]
    near = np.abs(depth) < reach
    axis.plot(scale * depth[near], per_force * branch.force[thin][near], ".", markersize=1.5, color="0.6")
    for i, (name, point) in enumerate(found.points.items()):
        place = fit.surface - point.surface
        if abs(place) < reach:
            axis.axvline(scale * place, color=f"C{i}", linewidth=1.0, label=name)
    legend_outside(axis)


def _modulus(axis: Any, found: Indentation, scale: float) -> None:
    word, factor = display_unit(found.law.unit)
    secant, tangent = found.secant, found.tangent
    for profile, colour, name in ((secant, "C0", "from contact on"), (tangent, "C1", "within windows")):
        value, std = factor * profile.modulus, factor * profile.std
        good = np.isfinite(value)
        if name == "within windows":
            axis.errorbar(
                scale * profile.depth[good],
                value[good],
                yerr=std[good],
                fmt="s",
                markersize=3,
                color=colour,
                label=name,
            )
        else:
            axis.plot(scale * profile.depth[good], value[good], color=colour, label=name)
            low, high = (value - std)[good], (value + std)[good]
            axis.fill_between(scale * profile.depth[good], low, high, color=colour, alpha=0.2, linewidth=0)
    axis.axhline(factor * found.fit.modulus, color="0.5", linestyle=":", label="fit")
    limits = common_limits([factor * secant.modulus, factor * tangent.modulus])
    if limits is not None:
        axis.set_ylim(*limits)
    axis.set_ylabel(f"{found.law.name} [{word}]")
    legend_outside(axis)
