"""How fast the filters are: kernels against filterpy and against C by hand, interleaved in one process.

Run it with: python benchmarks/filters_speed.py [samples], with "memory" for the memory of a long stream, and with
"online" for one sample at a time. It prints medians and ratios for benchmarks/results/filters.md.
"""

from __future__ import annotations

import ctypes
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi
import numpy as np
from palpate import Problem
from palpate_filters.ekf import ExtendedKalmanFilter
from palpate_filters.filter_tracker import Carry
from palpate_filters.inertial_filter import first_state
from palpate_filters.kinematic_filter import KinematicFilter
from palpate_filters.predictions import sigma_directions
from palpate_filters.ukf import AdaptiveFadingUkf
from palpate_kit.kernel.llvm import CompiledStep
from palpate_kit.kernel.virtual_machine import VirtualMachine
from palpate_models import DimensionalityReduction, Sphere
from palpate_testing import synthetic_samples

MODEL, MASS = DimensionalityReduction(indenter=Sphere(radius=5e-3)), 0.14
PROBLEM = Problem(MODEL, MASS)
ROUNDS = 5


def interleaved(runs: dict[str, tuple[int, Callable[[], object]]]) -> dict[str, float]:
    """Median processor time of one sample [s] of each, taken in turns; the number of samples goes with each."""
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(ROUNDS):
        for name, (count, run) in runs.items():
            before = time.process_time()
            run()
            seconds[name].append((time.process_time() - before) / count)
    return {name: float(np.median(found)) for name, found in seconds.items()}


def prepared(estimator: Any, samples: Any) -> tuple[Any, Any, np.ndarray, np.ndarray, np.ndarray]:
    """Both kernels of an estimator, and its state, samples and settings as arrays."""
    tracker = estimator.start(PROBLEM)
    recursion = tracker.recursion
    step = recursion.step
    outputs = [casadi.densify(step.next_state), casadi.densify(step.output)]
    function = casadi.Function("step", [step.state, step.sample, step.settings], outputs, {"cse": True})
    begun = recursion.begin(Carry(None, np.nan), samples[:260], False)
    assert begun is not None
    state, _ = begun
    inputs = recursion.inputs(samples, samples.interval)
    return VirtualMachine(function), CompiledStep(function), state, inputs, tracker._settings


def python_ekf(samples: Any, count: int) -> Callable[[], object]:
    """filterpy's EKF as one writes it by hand: numpy, the Jacobian in closed form."""
    from filterpy.kalman import ExtendedKalmanFilter as Ekf

    start = first_state(ExtendedKalmanFilter(), _process(), PROBLEM)
    kappa, lam = 16.0 / 9.0 * np.sqrt(5e-3), 8.0 * np.sqrt(5e-3)
    rate, force, T = -samples.velocity, samples.force, 0.002
    b = np.array([T**2 / (2 * MASS), T / MASS])
    Q = np.zeros((4, 4))
    Q[:2, :2] = np.outer(b, b) * 0.05**2
    row = np.array([[0.0, 1.0, 0.0, 0.0]])

    def run() -> object:
        kf = Ekf(4, 1)
        kf.x, kf.P, kf.Q, kf.R = start.mean.reshape(4, 1).copy(), np.diag(start.std**2), Q, np.array([[0.67e-3**2]])
        for i in range(count):
            if i:
                d, v, E, eta = kf.x[:, 0]
                root = max(d, 1e-5) ** 0.5
                u = force[i - 1] - (kappa * E * d * root + lam * eta * root * v if d > 0 else 0.0)
                slope = [1.5 * kappa * E * root + lam * eta * v / (2 * root), lam * eta * root]
                slope = np.array([*slope, kappa * d * root, lam * root * v]) * (d > 0)
                F = np.eye(4)
                F[0, 1] = T
                F[0] -= b[0] * slope
                F[1] -= b[1] * slope
                kf.F = F
                ahead = np.array([[d + T * v + b[0] * u], [v + b[1] * u], [E], [eta]])
                kf.predict()
                kf.x = ahead
            kf.update(np.array([[rate[i]]]), lambda x: row, lambda x: x[1:2])
        return kf.x

    return run


def python_afukf(samples: Any, count: int) -> Callable[[], object]:
    """filterpy's UKF with fading on the 8-state process, the process in plain floats."""
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter as Ukf

    settings = AdaptiveFadingUkf()
    start = first_state(settings, _process(2), PROBLEM)
    kappa, lam = 16.0 / 9.0 * np.sqrt(5e-3), 8.0 * np.sqrt(5e-3)
    rate, force, T = -samples.velocity, samples.force, 0.002
    b = np.array([T**2 / (2 * MASS), T / MASS])
    scale = start.std

    def ahead(x: Any, dt: float, u: float) -> Any:
        d, v, E, eta, E1, eta1, E2, eta2 = (x * scale).tolist()
        root = max(d, 0.0) ** 0.5
        excess = u - (kappa * E * d * root + lam * eta * root * v if d > 0 else 0.0)
        E, eta = E + T * E1 + T**2 / 2 * E2, eta + T * eta1 + T**2 / 2 * eta2
        return (
            np.array([d + T * v + b[0] * excess, v + b[1] * excess, E, eta, E1 + T * E2, eta1 + T * eta2, E2, eta2])
            / scale
        )

    def run() -> object:
        kf = Ukf(8, 1, T, lambda x: x[1:2], ahead, MerweScaledSigmaPoints(8, 0.5, 2.0, 0.0))
        kf.x, kf.P, kf.R = start.mean / scale, np.eye(8), np.array([[(0.67e-3 / scale[1]) ** 2]])
        kf.Q = np.zeros((8, 8))
        kf.Q[:2, :2] = np.outer(b / scale[:2], b / scale[:2]) * 0.05**2
        alpha = 1.0
        for i in range(count):
            kf.predict(u=force[max(i - 1, 0)])
            z = rate[i] / scale[1]
            alpha = min(1.02, alpha + 0.005) if abs(z - kf.x[1]) * scale[1] > 1e-3 else max(1.0, alpha - 0.005)
            kf.P = kf.P * alpha
            kf.update(np.array([z]))
        return kf.x

    return run


def _process(order: int = 0) -> Any:
    from palpate_filters.process_models import InertialProcess

    return InertialProcess(MODEL, MASS, order)


def by_hand(
    name: str, constants: list[float], state: np.ndarray, inputs: np.ndarray, settings: np.ndarray, folder: Path
) -> Callable[[], np.ndarray] | None:
    """The hand-written C of a filter, where there is a compiler."""
    library = folder / f"{name}.so"
    source = Path(__file__).parent / f"{name}_by_hand.c"
    try:
        subprocess.run(["cc", "-O3", "-march=native", "-shared", "-fPIC", str(source), "-o", str(library)], check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    call = ctypes.CDLL(str(library)).run
    fade = settings[2:14] if name == "afukf" else []
    numbers = np.array([*settings[:2], MASS, 16.0 / 9.0 * np.sqrt(5e-3), 8.0 * np.sqrt(5e-3), *fade, *constants])

    def run() -> np.ndarray:
        after, outputs = state.copy(), np.empty((len(inputs), 4))
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in (after, inputs, numbers, outputs)]
        call(ctypes.c_long(len(inputs)), *pointers)
        return outputs

    return run


def table(found: dict[str, float], reference: str) -> None:
    """Times and ratios of one filter."""
    for name, seconds in found.items():
        print(f"  {name:<28} {seconds * 1e6:9.3f} us   {found[reference] / seconds:8.1f} x {reference}")


def replay(count: int) -> None:
    """One setting over a record."""
    samples = synthetic_samples(MODEL, [1.1e5, 360.0], duration=count / 500)
    few = 1500
    with tempfile.TemporaryDirectory() as folder:
        for name, estimator, oracle in (
            ("ekf", ExtendedKalmanFilter(), python_ekf(samples, few)),
            ("afukf", AdaptiveFadingUkf(), python_afukf(samples, few)),
            ("kinematic-ekf", KinematicFilter(), None),
        ):
            vm, llvm, state, inputs, settings = prepared(estimator, samples)
            runs: dict[str, tuple[int, Callable[[], object]]] = {}
            if oracle is not None:
                runs["filterpy"] = (few, oracle)
            runs["virtual machine"] = (count, lambda vm=vm, a=(state, inputs, settings): vm.run(*a))
            runs["LLVM"] = (count, lambda k=llvm, a=(state, inputs, settings): k.run(*a))
            points = AdaptiveFadingUkf()
            _, weight, correction = sigma_directions("merwe", 8, points.spread, points.beta, points.kappa)
            constants = [np.sqrt(0.5 / weight), weight, correction] if name == "afukf" else []
            c = by_hand(name, constants, state, inputs, settings, Path(folder)) if oracle is not None else None
            if c is not None:
                runs["C by hand"] = (count, c)
                ours = llvm.run(state, inputs, settings)[1][:, :2]
                scale = np.max(np.abs(ours[-1000:]), axis=0)
                print(f"{name}: C by hand agrees within {np.max(np.abs(c()[:, :2] - ours)[-1000:] / scale):.1g}")
            print(f"{name}: processor time of one sample, medians of {ROUNDS}")
            table(interleaved(runs), "filterpy" if oracle is not None else "virtual machine")


def online(count: int = 5000) -> None:
    """One sample at a time: the kernel's step, and a sample to its estimate through the tracker."""
    samples = synthetic_samples(MODEL, [1.1e5, 360.0], duration=count / 500)
    for name, estimator in (("ekf", ExtendedKalmanFilter()), ("afukf", AdaptiveFadingUkf())):
        vm, llvm, state, inputs, settings = prepared(estimator, samples)
        tracker = estimator.start(PROBLEM)
        rows = [inputs[i : i + 1] for i in range(count)]
        blocks = [samples[i : i + 1] for i in range(count)]
        seconds: dict[str, list[float]] = {"virtual machine": [], "LLVM": [], "tracker": []}
        states = {"virtual machine": state, "LLVM": state}
        for i in range(count):
            for label, kernel in (("virtual machine", vm), ("LLVM", llvm)):
                before = time.perf_counter()
                states[label], _ = kernel.run(states[label], rows[i], settings)
                seconds[label].append(time.perf_counter() - before)
            before = time.perf_counter()
            tracker.run(blocks[i])
            seconds["tracker"].append(time.perf_counter() - before)
        told = ", ".join(f"{k} {1e6 * np.median(v):.1f}/{1e6 * np.quantile(v, 0.99):.1f}" for k, v in seconds.items())
        times = np.median(seconds["tracker"]) / np.median(seconds["LLVM"])
        print(f"{name} online, us, p50/p99: {told}; tracker {times:.1f} x the kernel")


def memory(count: int) -> None:
    """Samples streamed in blocks, in a process of their own: the most that it needs, and what the stream adds."""
    samples = synthetic_samples(MODEL, [1.1e5, 360.0], duration=20)
    tracker = ExtendedKalmanFilter().start(PROBLEM)
    tracker.run(samples)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.perf_counter()
    for _ in range(count // len(samples)):
        tracker.run(samples)
    seconds, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    more = (after - before) / 1024
    found = f"{seconds:.1f} s, {after / 1024:.0f} MB, {more:.1f} of it for the stream"
    print(f"{count:.0e} samples in blocks of {len(samples)}: {found}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["memory"]:
        memory(100_000_000)
    elif sys.argv[1:2] == ["online"]:
        online()
    else:
        number = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
        replay(number)
        online()
