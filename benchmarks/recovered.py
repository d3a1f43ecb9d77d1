"""How often each model finds the truth within its stated 95 %, by spectrum and by Ting, on simulated records.

A triangle in and out with 0.05 N and 5 um of noise for `ting-fit`; three sines for the spectrum; a ramp and a hold for
E(t). Counts are given with the exact binomial range at 99.9 %, and how many records were flagged as not determining a
parameter. For `casadi-fit` see coverage.py and coverage_memory.py.
``python benchmarks/recovered.py [--records 200] [--how METHOD] [NAME...]``
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from palpate import Problem, force_over_time
from palpate_fits import TingFit
from palpate_models import (
    Burgers,
    DimensionalityReduction,
    DimensionalityReductionMaxwell,
    FractionalKelvinVoigt,
    GeneralisedMaxwell2,
    Maxwell,
    Poroelastic,
    PowerLaw,
    Sphere,
    StandardLinearSolid,
)
from palpate_spectra.complex_moduli import measure_moduli
from palpate_spectra.recorded_oscillation import RecordedOscillation
from palpate_spectra.transient.recorded_press import longest_press
from palpate_spectra.transient.relaxation_modulus import modulus_curve
from palpate_spectra.transient.spectrum_of_times import flags_of
from scipy.stats import binom

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.simulated import samples, triangle
from tests.spectra import rig

TIP = Sphere(radius=5e-3)
STEP = 4e-3  # [s]
METHODS = ("by_spectrum", "by_ting", "by_relaxation")
UNTOLD = {"not-identifiable", "undetermined", "hard-to-tell-apart", "at-bound"}
MODELS = {
    "dr": (DimensionalityReduction(indenter=TIP), (100e3, 400.0)),
    "sls": (StandardLinearSolid(indenter=TIP), (100e3, 50e3, 0.2)),
    "sls+dashpot": (DimensionalityReductionMaxwell(indenter=TIP), (100e3, 200.0, 50e3, 0.4)),
    "maxwell": (Maxwell(indenter=TIP), (100e3, 60e3)),
    "burgers": (Burgers(indenter=TIP), (150e3, 200e3, 300e3, 10e3)),
    "generalised-maxwell-2": (GeneralisedMaxwell2(indenter=TIP), (100e3, 40e3, 0.05, 40e3, 1.0)),
    "power-law": (PowerLaw(indenter=TIP), (100e3, 0.15)),
    "fractional-kelvin-voigt": (FractionalKelvinVoigt(indenter=TIP), (60e3, 40e3, 0.4)),
    "poroelastic": (Poroelastic(indenter=TIP), (100e3, 0.2, 5e-6)),
}


def by_ting(model, theta, records):
    """The same of one loading and unloading after Ting."""
    t, depth = triangle()
    force = model.loading_cycle_force(t, depth, theta, 1e-6)
    return counted(
        lambda seed: TingFit().start(Problem(model, 0.0)).run(samples(t, depth, force, seed)), theta, records
    )


def counted(fit, theta, records):
    """How many of the records' intervals hold the truth, how many are flagged, and the seconds of a fit."""
    inside, flagged, began = np.zeros(len(theta), int), 0, time.process_time()
    for seed in range(records):
        found = fit(seed)
        rows = np.flatnonzero(np.isfinite(found.values).all(axis=1))
        if len(rows):
            inside += np.abs(found.values[rows[0]] - theta) < 1.96 * found.std[rows[0]]
        flagged += bool(UNTOLD & {flag.code for flag in found.flags})
    return inside, flagged, (time.process_time() - began) / records


def by_relaxation(model, theta, records):
    """E(t) of a hold at the points nearest to three times, against the model's own."""
    law, began = model.spectrum(theta), time.process_time()
    inside, flagged = np.zeros(3, int), 0
    for seed in range(records):
        found = modulus_curve(longest_press(rig.press(model, theta, seed=seed), "run"))
        at = [int(np.argmin(np.abs(np.log(found.time / t)))) for t in (0.3, 1.0, 4.0)]
        truth = (law.lasting or 0.0) + sum(e * np.exp(-rate * found.time[at]) for e, rate in law.arms)
        inside += np.abs(found.value[at] - truth) < 1.96 * found.std[at]
        flagged += any(flag.code == "not-linear-viscoelastic" for flag in flags_of(found))
    return inside, flagged, (time.process_time() - began) / records


def by_spectrum(model, theta, records):
    """G' and G'' of three lines within 1.99 standard deviations of the noise."""
    t = np.arange(-3.0, 10.0, STEP)
    lines = {0.5: 0.5e-3, 2.0: 0.3e-3, 5.0: 0.2e-3}
    depth = 4e-3 + sum(a * np.sin(2 * np.pi * f * t) for f, a in lines.items())
    rate = sum(2 * np.pi * f * a * np.cos(2 * np.pi * f * t) for f, a in lines.items())
    force, late = force_over_time(model, t, depth, rate, theta), t >= 0

    def lines_of(seed):
        random = np.random.default_rng(seed)
        noise = 0.0 if seed is None else random.standard_normal((2, len(t))) * [[0.05], [5e-6]]
        noisy, height = (np.stack([force, -depth]) + noise)[:, late]
        known = {"radius": 0.0, "poisson": 0.0}
        record = RecordedOscillation(
            "run", "t", model, t[late], noisy, height, 0.0, 0.0, timing=0.0, uncertainties=known
        )
        return measure_moduli(record, list(lines)).lines

    truth, began = [line.shear for line in lines_of(None)], time.process_time()
    inside = np.zeros((len(lines), 2), int)
    for seed in range(records):
        for i, line in enumerate(lines_of(seed)):
            error = line.shear - truth[i]
            inside[i] += np.abs([error.real, error.imag]) < 1.99 * line.noise
    return inside.ravel(), 0, (time.process_time() - began) / records


def main():
    """Print the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(MODELS))
    parser.add_argument("--records", type=int, default=200)
    parser.add_argument("--how", choices=[name.removeprefix("by_") for name in METHODS], action="append")
    asked = parser.parse_args()
    low, high = binom.ppf([5e-4, 1 - 5e-4], asked.records, 0.95)
    print(f"of {asked.records}; {low:.0f} to {high:.0f} expected")
    for how in [f"by_{name}" for name in asked.how or []] or METHODS:
        for name in asked.names or MODELS:
            model, theta = MODELS[name]
            if name == "poroelastic":
                continue  # its answer depends on the depth
            inside, flagged, seconds = globals()[how](model, np.array(theta), asked.records)
            print(f"{name:24} {how:14} {inside.tolist()}  flagged {flagged}  {1e3 * seconds:.0f} ms each", flush=True)


if __name__ == "__main__":
    main()
