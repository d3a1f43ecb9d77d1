"""Functions of samples and settings over whole columns: their values, or the sums of their products.

The sum over n samples of y y^T is all that least squares needs of a residual and its slopes y, in memory that does not
grow. Four samples are added at a time, each to one of four sums, in LLVM as in CasADi's virtual machine, so that both
give the same bits.
"""

from __future__ import annotations

import os
from typing import Any, Protocol

import numpy as np
from palpate import Floats
from palpate_kit.kernel.choice import VARIABLE, kernel_choice
from palpate_kit.kernel.translation import Untranslatable
from palpate_kit.kernel.virtual_machine import VirtualMachine

from palpate_fits.columns.column_table import LANES, ColumnTable
from palpate_fits.columns.compiled_columns import CompiledColumns

_MAX_EXPONENT = 4.5  # up to which products are faster than `pow` (choice)


_BLOCK = 8192  # samples in one sum (choice); sums of sums keep the rounding small
PAYS = 20_000  # samples, from which on LLVM is faster than the virtual machine, the load of its code included


class ColumnKernel(Protocol):
    """A function over columns; its settings (np,) or (m, np) are contiguous."""

    def values(self, table: ColumnTable, settings: Floats) -> Floats:
        """Return the values (ny, n)."""
        ...

    def lanes(self, table: ColumnTable, settings: Floats, length: int) -> Floats:
        """Return the sums (m, blocks, q, LANES) of products of values, of each settings and block of `length` rows."""
        ...


class ColumnFunction:
    """y (ny,) of a sample (nw,) and settings (np,), given as CasADi symbols; compiled once it has been used enough."""

    def __init__(self, sample: Any, settings: Any, output: Any) -> None:
        """Take a function y of symbols, which runs on the virtual machine until it has seen enough samples."""
        import casadi

        none = casadi.SX.sym("none")
        outputs = [none, casadi.densify(output)]
        function = casadi.Function("columns", [none, sample, settings], outputs, {"cse": True})
        self._function = with_roots(function)
        self._used, self._width = 0, int(output.numel())
        self._kernel: ColumnKernel = _OnVirtualMachine(self._function)
        # The place of each product y_i y_j among the sums, which have each pair once.
        self._upper = np.zeros((self._width, self._width), np.intp)
        first, second = np.triu_indices(self._width)
        self._upper[first, second] = self._upper[second, first] = np.arange(len(first))

    def values(self, table: ColumnTable, settings: Floats) -> Floats:
        """Return the values (ny, n) at every row of a table."""
        return self._used_for(len(table)).values(table, np.ascontiguousarray(settings, np.float64))

    def products(self, table: ColumnTable, settings: Floats) -> Floats:
        """Return the sum of y y^T over a table: (ny, ny) for settings (np,), (m, ny, ny) for settings (m, np)."""
        many = np.ascontiguousarray(settings, np.float64).reshape(-1, settings.shape[-1])
        lanes = self._used_for(len(table) * len(many)).lanes(table, many, _BLOCK)
        blocks = (lanes[..., 0] + lanes[..., 1]) + (lanes[..., 2] + lanes[..., 3])
        total = blocks[:, 0] if blocks.shape[1] == 1 else blocks.sum(axis=1)
        return total.take(self._upper, axis=1) if settings.ndim == 2 else total[0].take(self._upper)

    def _used_for(self, samples: int) -> ColumnKernel:
        """Count samples, and return the kernel: compiled from the call on that reaches `PAYS`."""
        before, self._used = self._used, self._used + samples
        if before < PAYS <= self._used:
            self._kernel = _compiled(self._function) or self._kernel
        return self._kernel


def _compiled(function: Any) -> ColumnKernel | None:
    """Return a function as machine code; None where LLVM is not chosen, or cannot compile it."""
    if kernel_choice()[0] != "llvm":
        return None
    try:
        return CompiledColumns(function)
    except (Untranslatable, ImportError, AttributeError, OSError, RuntimeError):
        if os.environ.get(VARIABLE) == "llvm":
            raise
        return None


class _OnVirtualMachine:
    """The function by CasADi's virtual machine."""

    def __init__(self, function: Any) -> None:
        self._machine = VirtualMachine(function)
        self._upper = np.triu_indices(int(function.numel_out(1)))

    def values(self, table: ColumnTable, settings: Floats) -> Floats:
        """See `ColumnKernel`."""
        return np.ascontiguousarray(self._machine.run(np.zeros(1), np.column_stack(table.columns), settings)[1].T)

    def lanes(self, table: ColumnTable, settings: Floats, length: int) -> Floats:
        """See `ColumnKernel`."""
        starts = range(0, len(table), length)
        sums = []
        for row in settings:
            sums.append([self._sums(table.part(start, start + length), row) for start in starts])
        return np.array(sums).reshape(len(settings), len(starts), len(self._upper[0]), LANES)

    def _sums(self, table: ColumnTable, settings: Floats) -> Floats:
        """Return the sums (q, LANES) of products y_i y_j over a table, the k-th sample in the lane k mod 4."""
        values = self.values(table, settings)
        first, second = self._upper
        with np.errstate(all="ignore"):  # the caller looks at numbers that are not finite
            products = np.ascontiguousarray((values[first] * values[second]).T)
            whole = len(products) // LANES * LANES
            sums = np.add.reduce(products[:whole].reshape(-1, LANES, len(first)), axis=0)
            sums[: len(products) - whole] += products[whole:]
        return np.asarray(sums.T)


def with_roots(function: Any) -> Any:
    """Return a CasADi function of symbols (SX) with each power of -4.5, -3.5 .. 4.5 as a product with a square root."""
    import casadi
    from palpate_kit.kernel.translation import operations

    names = operations()
    inputs = [casadi.SX.sym(f"i{k}", function.numel_in(k)) for k in range(function.n_in())]
    outputs = [casadi.SX.zeros(function.numel_out(k)) for k in range(function.n_out())]
    # The function's instructions again, one after the other; each writes a register, which later ones use again.
    registers: dict[int, Any] = {}
    constants: dict[int, float] = {}  # of registers that hold one
    for k in range(function.n_instructions()):
        code = function.instruction_id(k)
        name = names[code]
        arguments, targets = function.instruction_input(k), function.instruction_output(k)
        if name == "OP_OUTPUT":
            outputs[targets[0]][targets[1]] = registers[arguments[0]]
            continue
        # The value of the register by the operation's kind; the exponent of a power is its second argument.
        constant = None
        if name == "OP_CONST":
            constant = float(function.instruction_constant(k))
            value = casadi.SX(constant)
        elif name == "OP_INPUT":
            value = inputs[arguments[0]][arguments[1]]
        elif name in ("OP_POW", "OP_CONSTPOW") and _is_half_integer(constants.get(arguments[1])):
            value = _half_integer_power(registers[arguments[0]], exponent=constants[arguments[1]])
        elif len(arguments) == 1:
            value = casadi.SX.unary(code, registers[arguments[0]])
        else:
            value = casadi.SX.binary(code, *(registers[argument] for argument in arguments))
        registers[targets[0]] = value
        # A register that is written again holds its constant no longer.
        constants.pop(targets[0], None)
        if constant is not None:
            constants[targets[0]] = constant
    return casadi.Function(function.name(), inputs, [casadi.densify(output) for output in outputs], {"cse": True})


def _is_half_integer(exponent: float | None) -> bool:
    """Return True for -4.5, -3.5 .. 4.5."""
    return exponent is not None and abs(exponent) <= _MAX_EXPONENT and (2.0 * exponent) % 2.0 == 1.0


def _half_integer_power(base: Any, exponent: float) -> Any:
    """Return base^(n + 1/2) as sqrt(base) base ... base; its inverse for a negative exponent."""
    product = base**0.5
    for _ in range(int(abs(exponent))):
        product = product * base
    return product if exponent > 0 else 1.0 / product
