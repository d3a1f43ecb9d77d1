"""What a curve costs in `palpate fit`, to look at and to fit, against reading and fitting it with numpy and scipy.

Run it with: python benchmarks/many_curves.py [CURVES]. Processor time of a curve of 1000 samples, in turns in one
process, on one core. By hand is `numpy.loadtxt` and `scipy.optimize.curve_fit` on the formula of a sphere with the
right start: values and a covariance, no touch, no tare, no start to be found, no correlated residuals, no
intervals, no flags. To look at is what `palpate fit FOLDER --tip` does with a file before it is fitted.
"""

import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from palpate_engine import registry
from palpate_kit.curves.alike_logs import specimens_of
from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_fits import CurveReader, fit_curves
from palpate_kit.logs.draft_pipeline import suggestion_of
from scipy.optimize import curve_fit

RADIUS, ELASTICITY, VISCOSITY = 5e-3, 1.1e5, 360.0
PIPELINE = """
[device.log]
type = "csv-replay"
file = "0.csv"
rate = "500 Hz"
columns = { z = { column = 0, unit = "mm" }, v = { column = 1, unit = "mm/s" }, fz = { column = 2, unit = "N" } }
[alignment]
force = { channel = "log.fz", uncertainty = "0.2 ms" }
position = "log.z"
velocity = "log.v"
tare_duration = "0.2 s"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
[estimator.fit]
type = "casadi-fit"
segment = "cycle"
"""


def force(motion, elasticity, viscosity, surface):
    """A sphere's force [N] at heights and velocities (2, n)."""
    depth = np.maximum(1e-3 * surface - motion[0], 0.0)
    elastic = 16e5 / 9 * elasticity * np.sqrt(RADIUS) * depth**1.5
    return elastic - 8e2 * viscosity * np.sqrt(RADIUS * depth) * motion[1]


def write(count):
    """Curves, each a file of 1000 rows: mm, mm/s, N."""
    half = 425
    way = np.r_[np.arange(half), np.arange(half)[::-1]] * 4e-3 / half
    height, speed = np.r_[np.full(150, 1e-3), 1e-3 - way], 500 * 4e-3 / half
    velocity = np.r_[np.zeros(150), np.repeat([-speed, speed], half)]
    for i in range(count):
        clean = force(np.array([height, velocity]), ELASTICITY / 1e5 * (1 + 0.3 * np.sin(i)), VISCOSITY / 1e2, 0.0)
        noise = 0.02 * np.random.default_rng(i).standard_normal(len(clean))
        table = np.column_stack([1e3 * height, 1e3 * velocity, np.maximum(clean, 0.0) + noise])
        np.savetxt(f"{i}.csv", table, delimiter=",", fmt="%.8g", header="z (mm),v (mm/s),Force (N)", comments="")


def by_hand(name):
    """A curve read and fitted with numpy and scipy."""
    z, v, f = np.loadtxt(name, delimiter=",", skiprows=1).T
    return curve_fit(force, np.array([1e-3 * z, 1e-3 * v]), f - f[:100].mean(), [1.0, 3.0, 0.1])


def look_at(name, known):
    """How a curve is read, found out from its file."""
    for part in specimens_of(Path(name), known):
        suggestion_of(part.path, {**part.choices, "tip": "paraboloid 5 mm"}, known)


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        write(count)
        reader = CurveReader(PIPELINE, str(Path(folder, "reader.toml")), (), "log")
        curves = [Curve(f"{i}.csv", str(Path(folder, f"{i}.csv"))) for i in range(count)]
        fit_curves(reader, curves[:20])  # compiles
        known = registry.load()
        look_at(curves[0].file, known)  # builds the tip
        taken = {"look at": 0.0, "fit --each": 0.0, "loadtxt and curve_fit": 0.0}
        for begin in range(0, count, 20):
            start = time.process_time()
            for curve in curves[begin : begin + 20]:
                look_at(curve.file, known)
            before = time.process_time()
            fit_curves(reader, curves[begin : begin + 20])
            between = time.process_time()
            for curve in curves[begin : begin + 20]:
                by_hand(curve.file)
            taken["look at"] += before - start
            taken["fit --each"] += between - before
            taken["loadtxt and curve_fit"] += time.process_time() - between
    hand = taken["loadtxt and curve_fit"]
    print(f"{count} curves of 1000 samples, from file to values with uncertainties")
    for name, seconds in taken.items():
        each = seconds / count
        both = f"{1e3 * each:7.2f} ms   {seconds / hand:6.1f} x by hand"
        print(f"  {name:<24} {both}   10 000 on two cores: {5e3 * each:4.0f} s")


if __name__ == "__main__":
    main()
