"""Kernels: one symbolic step of a filter, run fast over many samples."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, Protocol

from palpate import Floats

from palpate_kit.kernel.choice import VARIABLE, kernel_choice
from palpate_kit.kernel.llvm import CompiledStep
from palpate_kit.kernel.translation import Untranslatable
from palpate_kit.kernel.virtual_machine import VirtualMachine

__all__ = ["Kernel", "Step", "compile_step", "kernel_choice", "step_function"]


# LLVM takes 2.5 s for 15 000 instructions and minutes for 130 000; interpreting 130 000 takes 1 to 4 ms a sample. Code
# below is made once and kept: a choice.
_MAX_BRIEF_INSTRUCTIONS = 20_000


@dataclass(frozen=True)
class Step:
    """One step of a filter as expressions in CasADi symbols (SX columns): state, sample, settings -> state, output."""

    state: Any  # (ns,) mean, covariance and what else is carried along
    sample: Any  # (nw,) one sample
    settings: Any  # (np,) numbers that may differ from run to run
    next_state: Any  # (ns,)
    output: Any  # (ny,)


class Kernel(Protocol):
    """Runs a step over a block of samples."""

    name: str

    def run(self, state: Floats, samples: Floats, settings: Floats) -> tuple[Floats, Floats]:
        """Return the state (ns,) after, and outputs (n, ny) of, the samples (n, nw); the same bits however they are
        cut."""
        ...


def step_function(step: Step) -> Any:
    """Return the CasADi function that every kernel is made from."""
    import casadi

    outputs = [casadi.densify(step.next_state), casadi.densify(step.output)]
    return casadi.Function("step", [step.state, step.sample, step.settings], outputs, {"cse": True})


def compile_step(step: Step, is_brief: bool = False) -> Kernel:
    """Return the fastest kernel that this machine has for a filter's step; all of them give the same bits.

    A brief one runs over some thousand samples once: a large step is then interpreted, which takes less time than
    making machine code of it.
    """
    function = step_function(step)
    is_worth_compiling = not is_brief or function.n_instructions() < _MAX_BRIEF_INSTRUCTIONS
    if kernel_choice()[0] == "llvm" and is_worth_compiling:  # the name; behind it is the reason
        try:
            return CompiledStep(function)
        except (Untranslatable, ImportError, AttributeError, OSError, RuntimeError):  # an old llvmlite, too
            if os.environ.get(VARIABLE) == "llvm":
                raise
    return VirtualMachine(function)


def kernel_description() -> str:
    """Return the kernel that a step really gets, not the one that it should, and why."""
    import casadi

    x, w, p = (casadi.SX.sym(name) for name in "xwp")
    return f"kernel: {compile_step(Step(x, w, p, x + p * w, x * w)).name} ({kernel_choice()[1]})"
