"""Every model with every estimator on one record whose truth is known: is there a wrong number that nothing flags?

Run it: python benchmarks/matrix.py [SEEDS] ; 84 tracks a seed, some three minutes each on two quiet cores.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from palpate_engine.config import Source, build_pipeline
from palpate_engine.pipeline import run_pipeline

RECORD = """
[run]
name = "matrix"
[device.rig]
type = "sim"
[device.rig.specimen]
model = "dr"
elasticity = "112.5 kPa"
viscosity = "362 Pa*s"
surface = "0.3 mm"
[trajectory.press]
type = "point"
bias = "4 mm"
amplitude = "1 mm"
frequency = "2 Hz"
duration = "10 s"
[alignment]
force = { channel = "rig.wrench.z", uncertainty = "0.1 ms" }
position = "rig.tip.z"
velocity = { channel = "rig.twist.z", uncertainty = "0.1 ms" }
measuring = "rig.setpoint.measuring"
tip_mass = "140 g"
[indenter.tip]
type = "sphere"
radius = "5 mm"
"""
TIPPED = {
    "dr": "dimensionality-reduction",
    "drm": "dimensionality-reduction-maxwell",
    "maxwell": "maxwell",
    "sls": "standard-linear-solid",
}
PLAIN = {"hc": "hunt-crossley", "hcf": "hunt-crossley-free", "kv": "kelvin-voigt"}
ESTIMATORS = {
    "ekf": {"type": "ekf"},
    "ukf": {"type": "ukf"},
    "afekf": {"type": "afekf"},
    "afekf-authors": {"type": "afekf", "preset": "authors"},
    "afukf": {"type": "afukf"},
    "kinematic": {"type": "kinematic-ekf"},
    "smoother": {"type": "kinematic-smoother"},
    "fit": {"type": "casadi-fit"},
    **{f"filterpy-{kind}": {"type": "filterpy", "filter": kind} for kind in ("ekf", "ukf", "ckf", "enkf")},
}
# What a model that holds the truth as a case of its own must find; F = kappa d^1.5 is 0.4472 N at 1 mm.
_KAPPA = 4 / 3 * 112.5e3 / 0.75 * 0.005**0.5 * 0.001**1.5
TRUTH = {
    "dr": {"elasticity": 112.5e3, "viscosity": 362.0},
    "drm": {"elasticity": 112.5e3},
    "sls": {"elasticity": 112.5e3},
    "hc": {"reference_force": _KAPPA},
    "hcf": {"reference_force": _KAPPA, "exponent": 1.5},
}


def matrix(seed, folder, tracks=None, duration="10 s"):
    """The result of the whole matrix, or of the tracks that are named."""
    source = Source(RECORD, Path("matrix.toml"))
    source.tables["model"] = {name: {"type": kind, "indenter": "tip"} for name, kind in TIPPED.items()}
    source.tables["model"] |= {name: {"type": kind} for name, kind in PLAIN.items()}
    source.tables["estimator"] = {name: dict(table) for name, table in ESTIMATORS.items()}
    source.tables["trajectory"]["press"]["duration"] = duration
    source.tables["run"] |= {"seed": seed} | ({"tracks": tracks} if tracks else {})
    return run_pipeline(build_pipeline(source), folder)


def nonsense(result):
    """Tracks that nothing flags and that are more than three combined uncertainties from the truth, in words."""
    found = []
    for name, track in result.tracks.items():
        if track.verdict != "good":  # or without a number
            continue
        model = name.partition("/")[0]
        if model not in TRUTH and not any(flag.severity == "doubtful" for flag in track.flags):
            found.append(f"{name}: cannot be the truth's model, and nothing says so")
        for parameter, truth in TRUTH.get(model, {}).items():
            value, u = track.parameters[parameter].value, track.parameters[parameter].combined
            if not abs(value - truth) <= 3 * u:
                found.append(f"{name}: {parameter} {value:.5g} +- {u:.2g} where {truth:.5g} is the truth")
    return found


def main(seeds):
    """All seeds, with what is wrong in each."""
    for seed in range(1, seeds + 1):
        with tempfile.TemporaryDirectory() as folder:
            result = matrix(seed, Path(folder) / "out")
        verdicts = [track.verdict for track in result.tracks.values()]
        counts = {word: verdicts.count(word) for word in ("good", "note", "doubtful", "invalid")}
        dr = [track for name, track in result.tracks.items() if name.startswith("dr/")]
        told = sum(track.verdict in ("good", "note") for track in dr)
        print(f"seed {seed}: {len(verdicts)} tracks, {counts}, of the true model {told} of {len(dr)} unflagged")
        print("\n".join(f"  {line}" for line in nonsense(result)) or "  no unflagged nonsense", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
