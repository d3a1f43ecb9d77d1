"""CasADi's virtual machine: always there, and a few hundred times faster than a filter written in numpy."""

from __future__ import annotations

from typing import Any

import numpy as np
from palpate import Floats

_BLOCK = 1000  # samples in one call: a choice; longer ones take seconds to build
_INPUTS = 3  # of a step: state, sample, settings
_MANY = 150  # samples from which on a block that is not full is faster than so many calls


class VirtualMachine:
    """Runs a step by `Function.buffer`, one sample a call, or a block a call by `mapaccum`: the same bits."""

    name = "CasADi virtual machine"

    def __init__(self, function: Any) -> None:
        self._single = _Call(function, 1)
        self._block: _Call | None = None

    def run(self, state: Floats, samples: Floats, settings: Floats) -> tuple[Floats, Floats]:
        """Return the state (ns,) after, and outputs (n, ny) of, the samples (n, nw), with `settings` of the step."""
        outputs = np.empty((len(samples), self._single.outputs))
        # Rows [0, by_block) run a block a call, and a last block may be padded; the others one a call.
        by_block = len(samples) // _BLOCK * _BLOCK
        if len(samples) - by_block >= _MANY:
            by_block = len(samples)
        if by_block and self._block is None:
            self._block = _Call(self._single.function, _BLOCK)
        for start in range(0, by_block, _BLOCK):
            assert self._block is not None
            stop = min(start + _BLOCK, by_block)
            state = self._block(state, samples[start:stop], settings, outputs[start:stop])
        for i in range(by_block, len(samples)):
            state = self._single(state, samples[i : i + 1], settings, outputs[i : i + 1])
        return state, outputs


class _Call:
    """A step over a fixed number of samples, with the memory that CasADi reads from and writes to."""

    def __init__(self, step: Any, length: int) -> None:
        """Prepare a step (state, sample, settings) -> (next state, output) for calls with `length` samples."""
        self.function = step
        states, width, settings = (step.size1_in(i) for i in range(_INPUTS))
        self.outputs = step.size1_out(1)
        self._state = np.zeros(states)
        self._samples = np.zeros((length, width))
        self._settings = np.zeros((length, settings))
        self._states = np.zeros((length, states))
        self._outputs = np.zeros((length, self.outputs))
        compiled = step if length == 1 else step.mapaccum("block", length, [0], [0])
        self._buffer, self._trigger = compiled.buffer()
        # Columns in CasADi are rows here: both keep one sample's numbers together in memory.
        for i, array in enumerate((self._state, self._samples, self._settings)):
            self._buffer.set_arg(i, memoryview(array.data))
        for i, array in enumerate((self._states, self._outputs)):
            self._buffer.set_res(i, memoryview(array.data))

    def __call__(
        self,
        state: Floats,
        samples: Floats,
        settings: Floats,
        outputs: Floats,
    ) -> Floats:
        count = len(samples)
        self._state[...], self._samples[:count], self._settings[...] = state, samples, settings
        self._samples[count:] = samples[-1]
        self._trigger()
        outputs[...] = self._outputs[:count]
        return np.array(self._states[count - 1])
