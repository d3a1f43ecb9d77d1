"""A filter's step over so few samples that compiling it may not pay."""

from __future__ import annotations

from palpate import Floats
from palpate_kit.kernel import Kernel, Step, compile_step, step_function
from palpate_kit.kernel.virtual_machine import VirtualMachine

from palpate_fits.columns.column_function import PAYS


class LazyKernel:
    """A kernel that is compiled once it has run over so many samples that this pays; the same bits before and after."""

    def __init__(self, step: Step) -> None:
        self._step, self._samples = step, 0
        self._kernel: Kernel = VirtualMachine(step_function(step))

    @property
    def name(self) -> str:
        """Of the kernel that is used now."""
        return self._kernel.name

    def run(self, state: Floats, samples: Floats, settings: Floats) -> tuple[Floats, Floats]:
        """See `Kernel.run`."""
        before, self._samples = self._samples, self._samples + len(samples)
        if before < PAYS <= self._samples:
            self._kernel = compile_step(self._step)
        return self._kernel.run(state, samples, settings)
