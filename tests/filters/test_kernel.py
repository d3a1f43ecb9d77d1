"""Kernels: every way of running a step gives the same bits."""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest
from palpate import ConfigurationError
from palpate_kit.kernel import Step, compile_step, kernel_choice
from palpate_kit.kernel.virtual_machine import VirtualMachine

pytest.importorskip("llvmlite")
from palpate_kit.kernel.llvm import CompiledStep
from palpate_kit.kernel.translation import Untranslatable

x, w, p = ca.SX.sym("x", 2), ca.SX.sym("w", 2), ca.SX.sym("p", 1)
a, b = w[0], w[1]

OPERATIONS: dict[str, Any] = {
    "arithmetic": (a + b) * (a - b) / (1 + ca.fabs(b)) - a**2 + 2 * b - a + 1 / b,
    "roots": ca.sqrt(ca.fabs(a)) + ca.fabs(b) ** 1.7 + ca.fabs(a) ** b,
    "transcendental": ca.exp(-ca.fabs(a)) + ca.log(ca.fabs(b)) + ca.sin(a) * ca.cos(b) + ca.tan(a),
    "inverse": ca.asin(ca.sin(a)) + ca.acos(ca.cos(b)) + ca.atan(a) + ca.atan2(a, b),
    "hyperbolic": ca.sinh(a) + ca.cosh(b) + ca.tanh(a) + ca.asinh(a) + ca.log1p(ca.fabs(b)) + ca.expm1(a) + ca.erf(b),
    "rounding": ca.floor(a) + ca.ceil(b) + ca.sign(a) * ca.copysign(a, b) + ca.fmod(a, 0.3) + ca.hypot(a, b),
    "extremes": ca.vertcat(1 / ca.fmax(a, b), 1 / ca.fmin(a, b)),
    "logic": ca.vertcat(
        ca.logic_and(a < b, a > -1), ca.logic_or(a <= b, b == 0), ca.logic_not(a), a != b, ca.if_else(a > 0, b, a)
    ),
}


def step(output: Any) -> ca.Function:
    following = ca.vertcat(0.5 * x[0] + p * a, x[1] + ca.if_else(ca.fabs(b) <= 1e300, b, 0.0))
    return ca.Function("step", [x, w, p], [following, ca.densify(ca.vertcat(output, x))], {"cse": True})


def awkward(n: int) -> np.ndarray:
    """Random numbers, with zeros of both signs, NaN, infinities and equal pairs among them."""
    random = np.random.default_rng(3)
    numbers = random.standard_normal((n, 2)) * 10.0 ** random.integers(-3, 3, (n, 2))
    special = [0.0, -0.0, np.nan, np.inf, -np.inf, 1.0]
    pairs = np.array([(one, other) for one in special for other in special])
    numbers[: len(pairs)] = pairs
    return numbers


def bits(numbers: np.ndarray) -> np.ndarray:
    """For comparing to the last bit, the sign of zero included; one NaN is as good as another."""
    return np.where(np.isnan(numbers), np.nan, numbers).view(np.int64)


@pytest.mark.parametrize("name", OPERATIONS)
def test_machine_code_gives_the_bits_of_the_virtual_machine(name: str) -> None:
    function = step(OPERATIONS[name])
    samples, state, settings = awkward(1203), np.array([0.3, -1.0]), np.array([0.7])
    expected = VirtualMachine(function).run(state, samples, settings)
    found = CompiledStep(function).run(state, samples, settings)
    for one, other in zip(found, expected, strict=True):
        assert np.array_equal(bits(one), bits(other))


@pytest.mark.parametrize("kind", [VirtualMachine, CompiledStep])
def test_blocks_give_the_bits_of_the_whole(kind: Any) -> None:
    function = step(OPERATIONS["roots"])
    samples, settings = awkward(2500), np.array([0.7])
    whole = kind(function).run(np.zeros(2), samples, settings)
    for cuts in ([0, 1, 2, 999, 1000, 2100, 2500], [0, 2499, 2500], [0, 0, 2500]):
        kernel, state, outputs = kind(function), np.zeros(2), []
        for first, last in pairwise(cuts):
            state, output = kernel.run(state, samples[first:last], settings)
            outputs.append(output)
        assert np.array_equal(bits(state), bits(whole[0]))
        assert np.array_equal(bits(np.vstack(outputs)), bits(whole[1]))


def test_one_sample_of_a_step_whose_arrays_are_all_of_other_lengths() -> None:
    names = (("x", 2), ("w", 3), ("p", 4))
    state, sample, settings = (ca.SX.sym(name, count) for name, count in names)
    output = ca.vertcat(state[0] * settings[3], sample[2] + settings[0], ca.sumsqr(settings), state[1], sample[0])
    function = ca.Function("step", [state, sample, settings], [state + sample[:2], output])
    given = np.array([0.3, -1.0]), np.array([[0.1, 7.0, -2.0]]), np.array([0.7, 11.0, -3.0, 5.0])
    expected, found = (kind(function).run(*given) for kind in (VirtualMachine, CompiledStep))
    for one, other in zip(found, expected, strict=True):
        assert np.array_equal(bits(one), bits(other))


def test_a_kernel_leaves_its_arguments_alone() -> None:
    kernel = CompiledStep(step(OPERATIONS["logic"]))
    state, samples, settings = np.ones(2), awkward(50), np.ones(1)
    copies = [state.copy(), samples.copy(), settings.copy()]
    kernel.run(state, samples, settings)
    for one, other in zip((state, samples, settings), copies, strict=True):
        assert np.array_equal(one, other, equal_nan=True)


def test_an_instruction_that_llvm_does_not_know_runs_on_the_virtual_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    odd = Step(x, w, p, x, ca.erfinv(ca.tanh(a)))
    with pytest.raises(Untranslatable, match="OP_ERFINV"):
        CompiledStep(ca.Function("step", [x, w, p], [x, odd.output]))
    monkeypatch.delenv("PALPATE_KERNEL", raising=False)
    assert isinstance(compile_step(odd), VirtualMachine)


@pytest.mark.parametrize(("is_brief", "name"), [(False, "LLVM"), (True, "CasADi virtual machine")])
def test_a_large_step_for_a_few_samples_is_interpreted(
    monkeypatch: pytest.MonkeyPatch, is_brief: bool, name: str
) -> None:
    """Machine code of 130 000 instructions takes minutes to make: here 30 are large."""
    monkeypatch.setattr("palpate_kit.kernel._MAX_BRIEF_INSTRUCTIONS", 30)
    output = ca.vertcat(*[ca.sin(k * a) * b for k in range(1, 12)])
    kernel = compile_step(Step(x, w, p, x, output), is_brief=is_brief)
    assert kernel.name == name


def test_the_kernel_can_be_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = Step(x, w, p, x, a)
    monkeypatch.setenv("PALPATE_KERNEL", "vm")
    assert kernel_choice()[0] == "vm"
    assert isinstance(compile_step(plain), VirtualMachine)
    monkeypatch.setenv("PALPATE_KERNEL", "llvm")
    assert isinstance(compile_step(plain), CompiledStep)
    monkeypatch.setenv("PALPATE_KERNEL", "fast")
    with pytest.raises(ConfigurationError, match="'fast' is not one of"):
        kernel_choice()


def test_without_llvmlite_the_virtual_machine_runs() -> None:
    """As where the extra `fast` is not installed."""
    program = (
        "import sys, importlib.metadata as m\n"
        "real = m.version\n"
        "def version(name):\n"
        "    if name == 'llvmlite': raise m.PackageNotFoundError(name)\n"
        "    return real(name)\n"
        "m.version = version\n"
        "sys.modules['llvmlite'] = None\n"
        "import casadi as ca\n"
        "from palpate_kit.kernel import Step, compile_step\n"
        "from palpate_kit.kernel import kernel_choice\n"
        "x, w, p = (ca.SX.sym(n) for n in 'xwp')\n"
        "print(compile_step(Step(x, w, p, x + w, x * p)).name, '|', kernel_choice()[1])\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("CasADi virtual machine | llvmlite is not installed")
