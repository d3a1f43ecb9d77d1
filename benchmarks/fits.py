"""How fast the offline fits are: solvers against each other, `scipy.optimize.curve_fit`, and nanite's lmfit.

Run: ``python benchmarks/fits.py [--large]``. Everything is interleaved in one process; medians and ratios are printed.
The peer `curve_fit` uses LAPACK, whose threads cost it processor time where they wait for one another: it is measured
with one thread and with as many as the library takes, and compared with the one.
"""

from __future__ import annotations

import resource
import statistics
import sys
import time
from collections.abc import Callable

import numpy as np
from palpate import Floats, Problem, Samples
from palpate_fits import CasadiFit
from palpate_fits.first_guess import first_guess, linear_places
from palpate_fits.loss import LossFunction
from palpate_fits.residual import Residual
from palpate_fits.solvers import solve_lm, solve_trf
from palpate_models import DimensionalityReduction, Sphere
from scipy.optimize import curve_fit
from threadpoolctl import ThreadpoolController

RADIUS, ELASTICITY, VISCOSITY, SURFACE = 5e-3, 112.5e3, 362.0, 0.3e-3
REPEATS = 15
_BLAS = ThreadpoolController()


def palpation(n: int) -> Samples:
    """Samples (n,) of a 2 Hz sine of 1 mm around a depth of 3 mm, noise as in the paper, 500 Hz."""
    random = np.random.default_rng(1)
    time_ = np.arange(n) / 500.0
    omega = 4 * np.pi
    depth, rate = 3e-3 + 1e-3 * np.sin(omega * time_), 1e-3 * omega * np.cos(omega * time_)
    force = 16 / 9 * ELASTICITY * np.sqrt(RADIUS) * depth**1.5 + 8 * VISCOSITY * np.sqrt(RADIUS * depth) * rate
    always = np.ones(n, bool)
    interval = np.full(n, 2e-3)
    interval[0] = 0.0
    return Samples(
        np.arange(n, dtype=np.int64) * 2_000_000,
        time_,
        interval,
        force + 0.05 * random.standard_normal(n),
        SURFACE - depth,
        -rate + 0.67e-3 * random.standard_normal(n),
        always,
        always.copy(),
    )


def interleaved(tasks: dict[str, Callable[[], object]], repeats: int = REPEATS) -> dict[str, float]:
    """Median processor seconds of each task, all run in turns after one warm-up."""
    seconds: dict[str, list[float]] = {name: [] for name in tasks}
    for turn in range(repeats + 1):
        for name, task in tasks.items():
            began = time.process_time()
            task()
            if turn:
                seconds[name].append(time.process_time() - began)
    return {name: statistics.median(times) for name, times in seconds.items()}


def single(task: Callable[[], object]) -> Callable[[], object]:
    """A task with one thread of BLAS and LAPACK."""

    def alone() -> object:
        with _BLAS.limit(limits=1):
            return task()

    return alone


def show(title: str, found: dict[str, float], reference: str) -> None:
    """Medians and ratios to one of them."""
    print(f"\n{title}")
    for name, median in found.items():
        print(f"  {name:<46} {1e3 * median:9.2f} ms   {median / found[reference]:7.2f} x {reference}")


def by_hand(at: Floats, elasticity: float, viscosity: float, surface: float) -> Floats:
    """A sphere's force [N] at heights and depth rates (2, n); parameters in 1e5 Pa, 1e2 Pa s and mm."""
    depth = np.maximum(1e-3 * surface - at[0], 0.0)
    return 16e5 / 9 * elasticity * np.sqrt(RADIUS) * depth**1.5 + 8e2 * viscosity * np.sqrt(RADIUS * depth) * at[1]


def solvers(n: int = 20_000) -> None:
    """The two solvers from the same start, and curve_fit on the same columns."""
    model = DimensionalityReduction(indenter=Sphere(radius=RADIUS))
    tracker = CasadiFit(profile=False, unknowns=()).start(Problem(model, None))
    fit = tracker.fit(palpation(n))  # type: ignore[attr-defined]
    record, unknowns, loss = fit.record, fit.unknowns, LossFunction()
    linear = linear_places(model, unknowns)
    residual = Residual(model, unknowns.free)
    guessed = first_guess(model, unknowns, record, linear, lambda places: Residual(model, places))
    start = solve_trf(residual, unknowns, record.thinned(1000), guessed, loss).x
    columns = np.column_stack([record.height, record.rate]).T

    guess = start[:3] / [1e5, 1e2, 1e-3]
    found = interleaved(
        {
            "lm": lambda: solve_lm(residual, unknowns, record, start, loss),
            "trf": lambda: solve_trf(residual, unknowns, record, start, loss),
            "scipy curve_fit, same start": single(lambda: curve_fit(by_hand, columns, record.force, guess)),
            "the same, all threads": lambda: curve_fit(by_hand, columns, record.force, guess),
        }
    )
    show(f"solve only, {n} samples, 3 unknowns", found, "scipy curve_fit, same start")
    values = {
        "lm": solve_lm(residual, unknowns, record, start, loss).x[0],
        "trf": solve_trf(residual, unknowns, record, start, loss).x[0],
        "curve_fit": 1e5 * curve_fit(by_hand, columns, record.force, guess)[0][0],
    }
    print("  E [Pa]: " + ", ".join(f"{name} {value:.4f}" for name, value in values.items()))


def whole(n: int = 20_000) -> None:
    """A fit from samples to minimum, and to the full report."""
    model = DimensionalityReduction(indenter=Sphere(radius=RADIUS))
    samples = palpation(n)
    default = CasadiFit().start(Problem(model, None))
    plain = CasadiFit(profile=False).start(Problem(model, None))

    def fit_by_hand() -> object:
        columns = np.array([samples.position, -samples.velocity])
        return curve_fit(by_hand, columns, samples.force, [1.0, 3.0, 0.1])

    found = interleaved(
        {
            "curve_fit by hand, from its start": single(fit_by_hand),
            "the same, all threads": fit_by_hand,
            "samples to minimum, default solver": lambda: plain.fit(samples),  # type: ignore[attr-defined]
            "samples to report, no profile": lambda: plain.run(samples),
            "samples to report": lambda: default.run(samples),
        },
        repeats=60,
    )
    show(f"whole fits, {n} samples, 3 unknowns", found, "curve_fit by hand, from its start")


def against_nanite(n: int = 4_000) -> None:
    """The paraboloid and a contact point on one atomic-force curve: nanite's lmfit and this."""
    try:
        import lmfit
        from nanite.model import models_available
    except ImportError:
        print("\nnanite is not installed: no comparison with it")
        return
    model = models_available["hertz_para"]
    random = np.random.default_rng(2)
    tip = np.linspace(2e-6, -1e-6, n)
    parameters = model.get_parameter_defaults()
    parameters["E"].value, parameters["R"].value, parameters["contact_point"].value = 3e3, 5e-6, 2e-7
    force = model.model(parameters, tip) + 2e-11 * random.standard_normal(n)
    parameters["E"].value, parameters["contact_point"].value = 1e3, 0.0
    parameters["E"].vary = parameters["contact_point"].vary = parameters["baseline"].vary = True
    rate = np.full(n, 3e-6)
    always = np.ones(n, bool)
    at = np.arange(n) * 1e-3 / 3
    interval = np.concatenate([[0.0], np.diff(at)])
    stamps = np.rint(at * 1e9).astype(np.int64)
    samples = Samples(stamps, at, interval, force, tip, -rate, tip < 2e-7, always)
    settings = CasadiFit(segment="all", fixed={"viscosity": 0.0}, unknowns=("bias",), profile=False)
    tracker = settings.start(Problem(DimensionalityReduction(indenter=Sphere(radius=5e-6)), None))
    found = interleaved(
        {
            "casadi-fit, samples to minimum": lambda: tracker.fit(samples),  # type: ignore[attr-defined]
            "casadi-fit, samples to report": lambda: tracker.run(samples),
            "nanite's residual through lmfit": lambda: lmfit.minimize(model.residual, parameters, args=(tip, force)),
        },
        repeats=7,
    )
    show(f"atomic-force curve, {n} samples, E, contact point, baseline", found, "nanite's residual through lmfit")


def large(n: int = 10_000_000) -> None:
    """Ten million samples: time, and memory beyond that of the samples."""
    model = DimensionalityReduction(indenter=Sphere(radius=RADIUS))
    samples = palpation(n)
    tracker = CasadiFit().start(Problem(model, None))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.perf_counter()
    estimates = tracker.run(samples)
    seconds = time.perf_counter() - began
    more = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    print(f"\n{n} samples: {seconds:.1f} s, peak memory {more / n:.0f} bytes a sample beyond making them")
    print(f"  the whole process: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9:.2f} GB")
    print(f"  E {estimates.values[-1, 0]:.2f} +- {estimates.std[-1, 0]:.2f} Pa")


if __name__ == "__main__":
    solvers()
    whole()
    against_nanite()
    if "--large" in sys.argv:
        large()
