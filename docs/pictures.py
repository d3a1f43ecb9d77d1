"""Draws the pictures of docs/models.md, and one of docs/calibration.md. Run: python docs/pictures.py"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from palpate import ContactModel, Indenter, contact_force, force_over_time, tip_profile
from palpate.offers import import_target
from palpate_engine import Source, build_parts
from palpate_kit.figures import WIDTHS, figure_of, legend_outside, save_figure, style
from palpate_models import DimensionalityReduction, palpate_indenters, palpate_models
from palpate_models.thickness import Thickness

FOLDER = Path(__file__).parent / "pictures"
EXAMPLE = Path(__file__).parents[1] / "pipelines" / "parts" / "tips.toml"
ELASTICITY, VISCOSITY = 112.5e3, 362.0  # the paper's soft silicone
DEPTH = 4e-3  # [m]

# Settings of a model that it cannot do without, apart from the tip.
SETTINGS: Mapping[str, dict[str, Any]] = {
    "dmt": {"radius": 5e-3},
    "jkr": {"radius": 5e-3},
    "two-layers": {"skin_thickness": 3e-3},
    "compression": {"diameter": 51e-3, "height": 22e-3},
}
# Parameters [SI] in the order of the model's.
NUMBERS: Mapping[str, list[float]] = {
    "dimensionality-reduction": [ELASTICITY, VISCOSITY],
    "standard-linear-solid": [ELASTICITY, 60e3, 0.1],
    "dimensionality-reduction-maxwell": [ELASTICITY, VISCOSITY, 60e3, 0.1],
    "maxwell": [ELASTICITY, 30e3],
    "generalised-maxwell-2": [ELASTICITY, 60e3, 0.1, 60e3, 0.5],
    "generalised-maxwell-3": [ELASTICITY, 4e4, 0.05, 4e4, 0.2, 4e4, 1.0],
    "generalised-maxwell-4": [ELASTICITY, 3e4, 0.05, 3e4, 0.2, 3e4, 1.0, 3e4, 5.0],
    "burgers": [2 * ELASTICITY, 60e3, 2 * ELASTICITY, 3e3],
    "power-law": [ELASTICITY, 0.2],
    "fractional-kelvin-voigt": [ELASTICITY, 30e3, 0.4],
    "poroelastic": [ELASTICITY, 0.1, 3e-6],
    "kelvin-voigt": [1000.0, 15.0],
    "hunt-crossley": [0.45, 5.0],
    "hunt-crossley-free": [0.5, 5.0, 1.4],
    "dmt": [ELASTICITY, 20.0],
    "jkr": [ELASTICITY, 20.0],
    "fung": [ELASTICITY, VISCOSITY, 4.0],
    "two-layers": [2 * ELASTICITY, 0.5 * ELASTICITY, VISCOSITY],
    "two-layers-free": [2 * ELASTICITY, 0.5 * ELASTICITY, VISCOSITY, 1.5e-3],
    "compression": [ELASTICITY],
}


def tips() -> dict[str, Indenter]:
    """Return every shipped tip with the settings of its example; ends the script where one has none."""
    examples: dict[str, Indenter] = build_parts(Source.read(EXAMPLE, named=False), "indenter")
    if missing := [name for name in palpate_indenters() if name not in examples]:
        raise SystemExit(f"{EXAMPLE} has no [indenter.{missing[0]}]")
    return {name: examples[name] for name in palpate_indenters()}


def models(tip: Indenter) -> dict[str, tuple[ContactModel, list[float]]]:
    """Return every shipped model, with numbers that make forces of the same order or those at which a fit begins."""
    shown = dict[str, tuple[ContactModel, list[float]]]()
    for name, target in palpate_models().items():
        part = import_target(target)
        tip_setting = {"indenter": tip} if "indenter" in part.model_fields else {}
        model = part(**tip_setting, **SETTINGS.get(name, {}))
        shown[name] = model, NUMBERS.get(name, [parameter.start for parameter in model.parameters])
    return shown


@style()
def draw_tips() -> None:
    """Profile and force over depth of every tip."""
    shapes = tips()
    figure, axes = figure_of(2, len(shapes), height=48.0)
    depth = np.linspace(0.0, DEPTH, 200)
    for (name, tip), (left, right) in zip(shapes.items(), axes, strict=True):
        radii, heights = tip_profile(tip, DEPTH)
        for side in (-1, 1):
            left.plot(side * 1e3 * radii, 1e3 * heights, color="black", linestyle="-")
        left.set(title=name, xlim=(-8, 8), ylim=(-0.3, 4.3), ylabel="z [mm]", aspect="equal")
        for poisson, look in ((0.5, "-"), (0.3, "--")):
            model = DimensionalityReduction(indenter=tip, poisson=poisson)
            right.plot(1e3 * depth, contact_force(model, depth, 0.0, [ELASTICITY, VISCOSITY]), look, color="C0")
        right.set(ylabel="F [N]", xlim=(0, 4))
    axes[-1][0].set_xlabel("r [mm]")
    axes[-1][1].set_xlabel("d [mm]")
    save(figure, "tips")


@style()
def draw_models() -> None:
    """Force over depth of every model on a sine of 2 Hz that fades in."""
    chosen = models(tips()["exact-sphere"])
    figure, axes = figure_of(4, -(-len(chosen) // 4), height=48.0)
    time = np.linspace(0.0, 2.0, 1601)
    omega = 2 * np.pi * 2.0
    fade = np.sin(np.pi / 2 * np.minimum(time / 0.5, 1.0)) ** 2
    depth = (3e-3 + 1e-3 * np.sin(omega * time)) * fade
    rate = np.gradient(depth, time)
    for axis, (name, (model, theta)) in zip(axes.flat, chosen.items(), strict=False):
        axis.plot(1e3 * depth, force_over_time(model, time, depth, rate, theta, pulls=False), linewidth=0.9)
        axis.set(title=name, xlabel="d [mm]", ylabel="F [N]")
        axis.title.set_fontsize(5.5)
    for axis in axes.flat[len(chosen) :]:
        axis.axis("off")
    save(figure, "models")


@style()
def draw_thickness() -> None:
    """The factor of every thickness correction over depth."""
    shapes, height = tips(), 22e-3
    cylinder = {"law": "finite-cylinder", "height": height, "diameter": 50e-3}
    laws = {
        "dimitriadis, bonded (sphere)": ("sphere", {"law": "dimitriadis", "height": height}),
        "dimitriadis, not bonded (sphere)": ("sphere", {"law": "dimitriadis", "height": height, "bonded": False}),
        "garcia (sphere)": ("sphere", {"law": "garcia", "height": height}),
        "garcia (flat)": ("flat", {"law": "garcia", "height": height}),
        "garcia (cone)": ("cone", {"law": "garcia", "height": height}),
        "finite-cylinder, bonded (sphere)": ("sphere", cylinder),
        "finite-cylinder, free (sphere)": ("sphere", cylinder | {"bonded": False}),
    }
    figure, axes = figure_of(width=WIDTHS["middle"], height=85.0)
    axis = axes[0, 0]
    depth = np.linspace(1e-6, 5e-3, 200)
    for label, (tip, settings) in laws.items():
        axis.plot(1e3 * depth, Thickness(**settings).factor(shapes[tip], depth)[0] + 0 * depth, label=label)
    axis.set(xlabel="d [mm]", ylabel="c(d), layer of 22 mm")
    legend_outside(axis, 2)
    save(figure, "thickness")


def late_runs(folder: Path) -> dict[str, tuple[Any, Any]]:
    """Time [s] and viscosity [Pa s] of pipelines/late.toml, before its calibration and after."""
    from palpate_calibration.guided_calibration import run_calibration
    from palpate_calibration.plan import load_plan
    from palpate_engine.config import load_pipeline
    from palpate_engine.pipeline import run_pipeline

    source = Path(__file__).parents[1] / "pipelines" / "late.toml"
    file = folder / "late.calibration.toml"
    file.write_text(run_calibration(load_plan(source))[0].text())
    tracks = ['run.tracks=["dr/kinematic"]']
    found = {}
    for label, more in (("before", []), ("after", [f"run.calibration={file}"])):
        result = run_pipeline(load_pipeline(source, [*tracks, *more]), folder / label)
        with (result.folder / "estimates.csv").open() as table:
            rows = [row for row in csv.DictReader(table) if row["dr/kinematic:viscosity"]]
        columns = ("time_s", "dr/kinematic:viscosity", "dr/kinematic:viscosity_std")
        time, value, std = (np.array([float(row[column]) for row in rows]) for column in columns)
        found[label] = time - time[0], (value, std)
    return found


@style()
def draw_late() -> None:
    """Viscosity over time from a force that is stamped 7 ms late, before and after `palpate calibrate`."""
    with TemporaryDirectory() as folder:
        runs = late_runs(Path(folder))
    figure, axes = figure_of(width=WIDTHS["middle"], height=70.0)
    axis = axes[0, 0]
    for (label, (time, (value, std))), colour in zip(runs.items(), ("C1", "C0"), strict=True):
        axis.plot(time, value, color=colour, label=f"{label} calibration")
        axis.fill_between(time, value - 2 * std, value + 2 * std, color=colour, alpha=0.2, linewidth=0)
    axis.axhline(VISCOSITY, color="black", linestyle=":", label="truth")
    axis.axhline(VISCOSITY - ELASTICITY / 3 * 7e-3, color="0.5", linestyle="--", label="truth less G times 7 ms")
    axis.set(xlabel="time [s]", ylabel="eta [Pa s]", ylim=(0, 500))
    legend_outside(axis, 2)
    save(figure, "late")


def save(figure: Any, name: str) -> None:
    """Write a picture that is the same on every run."""
    save_figure(figure, FOLDER / f"{name}.svg")


def main() -> None:
    """Draw all."""
    FOLDER.mkdir(exist_ok=True)
    for draw in (draw_tips, draw_models, draw_thickness, draw_late):
        draw()


if __name__ == "__main__":
    main()
