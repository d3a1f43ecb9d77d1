"""LLVM through llvmlite: a step as machine code, the loop over the samples inside."""

from __future__ import annotations

import ctypes
import ctypes.util
import sys
import threading
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats

from palpate_kit.kernel.code_cache import cached_code
from palpate_kit.kernel.translation import LIBRARY, Translation

_INPUTS = 3  # of a step: state, sample, settings; its output comes behind them
_ENGINES: list[Any] = []
COMPILING = threading.Lock()


class CompiledStep:
    """A step as machine code, over a block of samples or one of them."""

    name = "LLVM"

    def __init__(self, function: Any) -> None:
        self.outputs = int(function.numel_out(1))
        with COMPILING:
            self._scalar, self._single = _compiled(function.serialize())
        # One sample at a time, passing the arrays' addresses takes longest: these stay where they are.
        widths = [function.numel_in(i) for i in range(_INPUTS)]
        shapes = [widths[0], (1, widths[1]), widths[2], (1, self.outputs)]
        self._held = [np.zeros(shape) for shape in shapes]
        self._places = np.array([array.ctypes.data for array in self._held], np.uint64)
        self._where: int = self._places.ctypes.data

    def run(self, state: Floats, samples: Floats, settings: Floats) -> tuple[Floats, Floats]:
        """Return the state (ns,) after, and outputs (n, ny) of, the samples (n, nw)."""
        if len(samples) == 1:
            held_state, held_sample, held_settings, output = self._held
            held_state[...], held_sample[...], held_settings[...] = state, samples, settings
            self._single(self._where)
            return held_state.copy(), output.copy()
        arrays = [np.array(state, float), *(np.ascontiguousarray(array, float) for array in (samples, settings))]
        arrays.append(np.empty((len(samples), self.outputs)))
        self._scalar(len(samples), *(array.ctypes.data for array in arrays))
        return arrays[0], arrays[_INPUTS]


@cache
def _compiled(text: str) -> tuple[Callable[..., None], Callable[[int], None]]:
    """Return the machine code of a serialised step, over a block and of one sample; one for each step in a process."""
    address = code_addresses("step", text, Translation)
    pointer = ctypes.c_void_p
    block = ctypes.CFUNCTYPE(None, ctypes.c_int64, *([pointer] * (_INPUTS + 1)))
    single = ctypes.PYFUNCTYPE(None, pointer)  # over before another thread could make use of the interpreter
    return block(address("run")), single(address("single"))


def code_addresses(kind: str, text: str, translator: type[Translation]) -> Callable[[str], int]:
    """Return the function from a name to the address of that function of the machine code.

    The code is translated now, or was kept on disk by its causes. `text` is the serialised CasADi function, `kind` a
    word for the kind of code that is made of it.
    """
    import llvmlite.binding as binding

    machine = _machine()
    processor = binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten(), machine.triple
    causes = (kind, text, version("llvmlite"), _sources(translator), *processor)
    code = cached_code(causes, lambda: _translated(text, machine, translator))
    engine = binding.create_mcjit_compiler(binding.parse_assembly(""), machine)
    engine.add_object_file(binding.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _ENGINES.append(engine)  # the code lives as long as its engine
    address_of: Callable[[str], int] = engine.get_function_address
    return address_of


def _translated(text: str, machine: Any, translator: type[Translation]) -> bytes:
    """Return the machine code of a serialised function, as an object file."""
    import casadi
    import llvmlite.binding as binding

    module = binding.parse_assembly(str(translator(casadi.Function.deserialize(text)).module()))
    module.verify()
    tuning = binding.create_pipeline_tuning_options(speed_level=2)
    builder = binding.create_pass_builder(machine, tuning)
    builder.getModulePassManager().run(module, builder)
    return bytes(machine.emit_object(module))


def _sources(translator: type[Translation]) -> str:
    """Return a hash of the way from a function to its code: this file, and those of the translation."""
    modules = (sys.modules[base.__module__] for base in translator.__mro__ if base is not object)
    files = (__file__, *(module.__file__ for module in modules))
    return sha256(b"".join(Path(file).read_bytes() for file in files if file)).hexdigest()


def _machine() -> Any:
    """Return this machine, with all that its processor can do."""
    import llvmlite.binding as binding

    _library()
    target = binding.Target.from_default_triple()
    features = binding.get_host_cpu_features().flatten()
    return target.create_target_machine(opt=2, cpu=binding.get_host_cpu_name(), features=features, jit=True)


@cache
def _library() -> None:
    """Start LLVM, and register the functions of the C library."""
    import llvmlite.binding as binding

    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    library = ctypes.CDLL(ctypes.util.find_library("m"))
    for name in set(LIBRARY.values()):
        address = ctypes.cast(getattr(library, name), ctypes.c_void_p).value
        binding.add_symbol(f"palpate_{name}", address)  # LLVM does not rewrite calls of these names
