"""A file of 1000 samples from its bytes to its values, by palpate and by its peers, and what each gives.

Run it with: python benchmarks/peers.py [CURVES]. Processor time of a curve, in turns in one process, one thread of
BLAS; medians of three rounds and the ratio to `numpy.loadtxt` and `curve_fit`. nanite reads the same numbers from
files of afmformats. Its rating and the intervals of lmfit take a fifth of a second and more: two curves a round.
"""

from __future__ import annotations

import json
import os
import statistics
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import lmfit
import nanite
import numpy as np
import pandas as pd
from many_curves import ELASTICITY, PIPELINE, RADIUS, by_hand, force, look_at, write
from palpate_engine import registry
from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_fits import CurveReader, fit_curves
from scipy.optimize import curve_fit

ROUNDS, SLOW_CURVES = 3, 2
STEP = 2e-3  # [s]
TOUCH_ROWS = 575  # of a curve, on the way down
HAND = "loadtxt, curve_fit"


def write_for_nanite(count: int) -> None:
    """Write the same curves as files of afmformats, in N and m."""
    for i in range(count):
        height, _, measured = np.loadtxt(f"{i}.csv", delimiter=",", skiprows=1).T
        metadata = {"imaging mode": "force-distance", "spring constant": 1e6, "point count": len(height)}
        lines = ["afmformats file", "metadata", "BEGIN METADATA", *json.dumps(metadata, indent=2).split("\n")]
        lines += ["END METADATA", "", "force\theight (measured)\tsegment\ttime"]
        rows = np.arange(len(height))
        table = np.column_stack([measured, 1e-3 * height, rows >= TOUCH_ROWS, STEP * rows])
        np.savetxt(f"{i}.tab", table, "%.9g", "\t", header="\n".join(lines), comments="# ")


def by_nanite(i: int, is_rated: bool = False) -> float:
    """Return E [Pa] by nanite: load, preprocess, fit, and rate where that is asked for."""
    curve = nanite.load_group(Path(f"{i}.tab"))[0]
    curve.apply_preprocessing(["compute_tip_position", "correct_force_offset", "correct_tip_offset"])
    start = nanite.model.get_init_parms("hertz_para")
    start["R"].value = RADIUS
    curve.fit_model(model_key="hertz_para", params_initial=start, preprocessing=curve.preprocessing)
    if is_rated:
        curve.rate_quality(regressor="Extra Trees")
    return float(curve.fit_properties["params_fitted"]["E"].value)


def with_bias(height, velocity, elasticity, viscosity, surface, bias):
    """A sphere's force [N] with an offset."""
    return force(np.array([height, velocity]), elasticity, viscosity, surface) + bias


def columns_of(i: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return height [m], velocity [m/s] and force [N] less its tare, by pandas."""
    height, velocity, measured = pd.read_csv(f"{i}.csv").to_numpy().T
    return 1e-3 * height, 1e-3 * velocity, measured - measured[:100].mean()


def by_pandas(i: int) -> float:
    """Return E [Pa] by pandas and curve_fit."""
    height, velocity, measured = columns_of(i)
    return 1e5 * float(
        curve_fit(lambda at, *values: with_bias(*at, *values), (height, velocity), measured, [1.0, 3.0, 0.1, 0.0])[0][0]
    )


def by_lmfit(i: int, has_intervals: bool = False) -> float:
    """Return E [Pa] by lmfit, with the intervals of its profiles where they are asked for."""
    height, velocity, measured = columns_of(i)
    model = lmfit.Model(with_bias, independent_vars=["height", "velocity"])
    start = {"elasticity": 1.0, "viscosity": 3.0, "surface": 0.1, "bias": 0.0}
    fit = model.fit(measured, height=height, velocity=velocity, **start)
    if has_intervals:
        fit.conf_interval()
    return 1e5 * float(fit.params["elasticity"].value)


def seconds_of(task: Callable[[int], object], curves: range) -> float:
    """Return the processor time [s] of a curve."""
    before = time.process_time()
    for i in curves:
        task(i)
    return (time.process_time() - before) / len(curves)


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        write(count)
        write_for_nanite(count)
        reader, known = CurveReader(PIPELINE, str(Path(folder, "reader.toml")), (), "log"), registry.load()

        def by_palpate(i: int) -> float:
            look_at(f"{i}.csv", known)
            [[row]] = [list(rows) for rows in fit_curves(reader, [Curve(f"{i}.csv", str(Path(folder, f"{i}.csv")))])]
            return float(row["elasticity"])

        tasks: dict[str, tuple[Callable[[int], float], str]] = {
            HAND: (lambda i: 1e5 * float(by_hand(f"{i}.csv")[0][0]), "covariance of white noise"),
            "pandas, curve_fit": (by_pandas, "the same"),
            "lmfit": (by_lmfit, "the same"),
            "lmfit with intervals": (lambda i: by_lmfit(i, True), "profile intervals"),
            "nanite": (by_nanite, "E, contact point"),
            "nanite with its rating": (lambda i: by_nanite(i, True), "the same, a rating"),
            "palpate, look and row": (by_palpate, "u, budget, diagnoses, verdict"),
        }
        slow = ("lmfit with intervals", "nanite with its rating")
        errors = {name: task(0) / ELASTICITY - 1.0 for name, (task, _) in tasks.items()}  # imports and compiles
        rounds = [
            {name: seconds_of(task, range(SLOW_CURVES if name in slow else count)) for name, (task, _) in tasks.items()}
            for _ in range(ROUNDS)
        ]
    print(f"{count} curves of 1000 samples, {ROUNDS} rounds, from file to values; by the first curve E is off by")
    for name, (_, gives) in tasks.items():
        milliseconds = 1e3 * statistics.median(seconds[name] for seconds in rounds)
        ratio = statistics.median(seconds[name] / seconds[HAND] for seconds in rounds)
        print(f"  {name:<24}{milliseconds:9.2f} ms {ratio:8.1f} x by hand {100 * errors[name]:7.2f} %   {gives}")


if __name__ == "__main__":
    main()
