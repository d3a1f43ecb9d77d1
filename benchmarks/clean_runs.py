"""How often a clean run is called doubtful: random simulated palpations in which every assumption holds.

Run: python benchmarks/clean_runs.py [RUNS [FIRST SEED]]. Each run draws material, tip, depth, amplitude, frequency and
noise for `pipelines/filters.toml`, in ranges where the force determines E and eta to a tenth, no deeper than the tip's
radius; everything is declared as it is. The tracks are of estimators that are documented as unbiased there: the
kinematic filter, the smoother and the fit.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline

PIPELINE = Path(__file__).parents[1] / "pipelines" / "filters.toml"
ESTIMATORS = {"kinematic": "kinematic-ekf", "smoother": "kinematic-smoother", "fit": "casadi-fit"}


def overrides(random: np.random.Generator) -> list[str]:
    """Settings of a clean run."""
    elasticity = 10.0 ** random.uniform(4.3, 5.7)  # [Pa]
    delay = random.uniform(5e-3, 20e-3)  # [s] eta/G
    radius = random.uniform(2.5e-3, 10e-3)  # [m]
    depth = min(random.uniform(1.5e-3, 4e-3), 0.67 * radius)  # [m]; the amplitude adds at most a half
    amplitude, frequency = depth * random.uniform(0.15, 0.5), random.uniform(1.0, 4.0)  # [m], [Hz]
    swing = 16.0 / 9.0 * elasticity * np.sqrt(radius) * 1.5 * np.sqrt(depth) * amplitude  # [N]
    noise = swing * 10.0 ** random.uniform(-2.5, -1.3)  # [N]
    numbers = {
        "device.rig.specimen.elasticity": f"{elasticity:.6g} Pa",
        "device.rig.specimen.viscosity": f"{elasticity / 3.0 * delay:.6g} Pa*s",
        "device.rig.force_std": f"{noise:.4g} N",
        "indenter.tip.radius": f"{radius:.6g} m",
        "trajectory.press.bias": f"{depth:.6g} m",
        "trajectory.press.amplitude": f"{amplitude:.6g} m",
        "trajectory.press.frequency": f"{frequency:.4g} Hz",
        "trajectory.press.duration": "6 s",
        "run.seed": str(int(random.integers(1 << 30))),
        "run.tracks": '["dr/kinematic", "dr/smoother", "dr/fit"]',
    }
    chosen = [f"{key}={value}" for key, value in numbers.items()]
    measured = ', noise = "measure"'
    return chosen + [
        f'estimator.{name}={{type = "{kind}"{measured if name != "fit" else ""}}}' for name, kind in ESTIMATORS.items()
    ]


def main() -> None:
    """Print the share of good tracks by estimator, the codes of the others, and coverage."""
    runs, first = (int(text) for text in [*sys.argv[1:], *("2000", "0")[len(sys.argv) - 1 :]])
    good, covered, total, codes = Counter(), Counter(), Counter(), Counter()
    with tempfile.TemporaryDirectory() as scratch:
        for seed in range(first, first + runs):
            out = Path(scratch) / "out"
            result = run_pipeline(load_pipeline(PIPELINE, overrides(np.random.default_rng(seed))), out)
            for name, track in result.tracks.items():
                total[name] += 1
                good[name] += track.verdict in ("good", "note")
                for key, value in track.parameters.items():
                    covered[name, key] += abs(value.value - result.truth[key]) < 2.0 * value.combined
                for flag in (*result.flags, *track.flags):
                    if flag.severity != "note":
                        codes[name, flag.code] += 1
                        print(f"run {seed} {name}: {flag}", file=sys.stderr)
            shutil.rmtree(out)
    for name in total:
        inside = ", ".join(
            f"{key} {100 * n / total[name]:.1f} %" for (track, key), n in covered.items() if track == name
        )
        print(f"{name}: {100 * good[name] / total[name]:.1f} % good of {total[name]}; within 2u: {inside}")
    for (name, code), count in sorted(codes.items()):
        print(f"  {name} {code}: {count}")


if __name__ == "__main__":
    main()
