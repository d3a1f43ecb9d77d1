"""Kernels: one symbolic step of a filter, run fast over many samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from palpate.estimation import Floats
from palpate.kernel.virtual_machine import VirtualMachine

__all__ = ["Kernel", "Step", "compile_step"]


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
        """State (ns,) after, and outputs (n, ny) of, the samples (n, nw); the same bits however they are cut."""
        ...


def compile_step(step: Step) -> Kernel:
    """The fastest kernel that this machine has, for a step."""
    return VirtualMachine(step.state, step.sample, step.settings, step.next_state, step.output)
