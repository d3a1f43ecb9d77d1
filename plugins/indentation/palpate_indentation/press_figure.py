"""The picture of a press: force and fit, the contact points, the modulus over depth, the way out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from palpate_engine import display_unit
from palpate_kit.figures import common_limits, figure_of, force_unit, legend_outside, save_figure, style

from palpate_indentation.modulus_over_depth import ModulusProfile
from palpate_indentation.press import Branch
from palpate_indentation.press_analysis import Indentation

_MAX_POINTS = 4000  # of a curve, a choice: more are not distinguished in a panel
_MIN_DEPTH_IN_MM = 1e-4  # [m], a choice: shallower presses are drawn in um
_CONTACT_SHARE = 0.15  # of the depth, a choice: half of the width of the panel about the contact point
_DOTS = {"marker": ".", "linestyle": "none", "markersize": 1.5, "color": "0.6"}


@style()
def draw(analysis: Indentation, path: Path) -> None:
    """Save four panels, or three where there was no way out; raises OutputError."""
    figure, panels = figure_of(2, 2)
    force_panel, contact_panel, modulus_panel, out_panel = panels.ravel()
    length, per_length = ("mm", 1e3) if analysis.depth > _MIN_DEPTH_IN_MM else ("um", 1e6)
    force, per_force = force_unit(float(np.ptp(analysis.branch.force)))
    fit, branch = analysis.fit, analysis.branch
    rows = _thin_rows(branch)
    depth = per_length * (fit.surface - branch.height[rows])

    force_panel.plot(depth, per_force * branch.force[rows], label="measured", **_DOTS)
    force_panel.plot(depth, per_force * (branch.force - fit.residual)[rows], color="C0", label="fit")
    labels = {"xlabel": f"depth [{length}]", "ylabel": f"force [{force}]"}
    force_panel.set(**labels)
    legend_outside(force_panel)
    _draw_contact(contact_panel, analysis, per_length, per_force)
    contact_panel.set(**labels)
    _draw_modulus(modulus_panel, analysis, per_length)
    modulus_panel.set(xlabel=labels["xlabel"])
    way_out = analysis.press.retract
    if way_out is not None:
        out_rows = _thin_rows(way_out)
        out_depth = per_length * (fit.surface - way_out.height[out_rows])
        out_panel.plot(depth, per_force * branch.force[rows], linewidth=0.8, color="0.7", label="in")
        out_panel.plot(out_depth, per_force * way_out.force[out_rows], label="out")
        out_panel.set(**labels)
        legend_outside(out_panel)
    else:
        out_panel.axis("off")
    save_figure(figure, path)


def _thin_rows(branch: Branch) -> slice:
    """Return every so many rows of a branch that few enough are left to be drawn."""
    return slice(None, None, max(len(branch) // _MAX_POINTS, 1))


def _draw_contact(panel: Any, analysis: Indentation, per_length: float, per_force: float) -> None:
    """Draw the force about the contact point, with a line for the surface by every method."""
    fit, branch = analysis.fit, analysis.branch
    reach = _CONTACT_SHARE * analysis.depth
    rows = _thin_rows(branch)
    depth = fit.surface - branch.height[rows]
    is_near = np.abs(depth) < reach
    panel.plot(per_length * depth[is_near], per_force * branch.force[rows][is_near], **_DOTS)
    for i, (name, point) in enumerate(analysis.points.items()):
        point_depth = fit.surface - point.surface
        if abs(point_depth) < reach:
            panel.axvline(per_length * point_depth, color=f"C{i}", linewidth=1.0, label=name)
    legend_outside(panel)


def _draw_modulus(panel: Any, analysis: Indentation, per_length: float) -> None:
    """Draw the modulus over depth from contact on as a band, within windows as bars, and that of the fit."""
    unit, per_unit = display_unit(analysis.law.unit)
    depth, value, std = _scaled_profile(analysis.secant, per_length, per_unit)
    panel.plot(depth, value, color="C0", label="from contact on")
    panel.fill_between(depth, value - std, value + std, color="C0", alpha=0.2, linewidth=0)
    depth, value, std = _scaled_profile(analysis.tangent, per_length, per_unit)
    panel.errorbar(depth, value, yerr=std, fmt="s", markersize=3, color="C1", label="within windows")
    panel.axhline(per_unit * analysis.fit.modulus, color="0.5", linestyle=":", label="fit")
    limits = common_limits([per_unit * analysis.secant.modulus, per_unit * analysis.tangent.modulus])
    if limits is not None:
        panel.set_ylim(*limits)
    panel.set_ylabel(f"{analysis.law.name} [{unit}]")
    legend_outside(panel)


def _scaled_profile(profile: ModulusProfile, per_length: float, per_unit: float) -> tuple[Any, Any, Any]:
    """Return depth, modulus and standard uncertainty (m,) in display units, where there is a modulus."""
    has_modulus = np.isfinite(profile.modulus)
    columns = per_length * profile.depth, per_unit * profile.modulus, per_unit * profile.std
    depth, value, std = (column[has_modulus] for column in columns)
    return depth, value, std
