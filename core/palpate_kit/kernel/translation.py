"""From CasADi's instructions to LLVM's.

CasADi's virtual machine evaluates one instruction after the other in double precision. Here each of them becomes one
LLVM instruction without leave to reassociate or contract, and functions such as pow are those of the same C library,
so that the numbers are the same bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

# CasADi operation -> function of the C library; the number of arguments follows.
LIBRARY = {
    "OP_EXP": "exp",
    "OP_LOG": "log",
    "OP_POW": "pow",
    "OP_CONSTPOW": "pow",
    "OP_SIN": "sin",
    "OP_COS": "cos",
    "OP_TAN": "tan",
    "OP_ASIN": "asin",
    "OP_ACOS": "acos",
    "OP_ATAN": "atan",
    "OP_SINH": "sinh",
    "OP_COSH": "cosh",
    "OP_TANH": "tanh",
    "OP_ASINH": "asinh",
    "OP_ACOSH": "acosh",
    "OP_ATANH": "atanh",
    "OP_ATAN2": "atan2",
    "OP_FMOD": "fmod",
    "OP_LOG1P": "log1p",
    "OP_EXPM1": "expm1",
    "OP_HYPOT": "hypot",
    "OP_ERF": "erf",
    "OP_COPYSIGN": "copysign",
}
_POINTERS = 4  # arguments behind the count: state, samples, settings, outputs
_OUTPUT = 3  # of them
_BITS, _BYTES = 64, 8  # of a whole number and of a double
INTRINSICS = {"OP_SQRT": "sqrt", "OP_FABS": "fabs", "OP_FLOOR": "floor", "OP_CEIL": "ceil"}
COMPARISONS = {"OP_LT": "<", "OP_LE": "<=", "OP_EQ": "=="}


class Untranslatable(Exception):  # noqa: N818  (a signal to the chooser of kernels)
    """A step has an instruction that this kernel does not know, or the machine cannot compile."""


class Translation:
    """The instruction list of a CasADi function as one LLVM function that loops over samples."""

    def __init__(self, function: Any) -> None:
        from llvmlite import ir

        self._ir, self._function = ir, function
        self._double = ir.DoubleType()
        self._names = operations()
        self._declared: dict[str, Any] = {}

    def module(self) -> Any:
        """Return the LLVM module, with the functions `run` and `single`.

        `run` has the arguments count, state (ns,), samples (count, nw), settings, outputs (count, ny). It loops over
        the samples; each overwrites the state, and writes a row of the outputs.
        """
        ir = self._ir
        self._module = ir.Module(name="step")
        integer, pointer = ir.IntType(_BITS), self._double.as_pointer()
        signature = ir.FunctionType(ir.VoidType(), [integer, *([pointer] * _POINTERS)])
        run = ir.Function(self._module, signature, name="run")
        for argument in run.args[1:]:
            argument.add_attribute("noalias")
        count, *self._arrays = run.args
        entry, body, done = (run.append_basic_block(name) for name in ("entry", "body", "done"))
        self._b = ir.IRBuilder(entry)
        # A loop over the samples, none of which may run: entry, body, done.
        zero, one = integer(0), integer(1)
        self._b.cbranch(self._b.icmp_signed(">", count, zero), body, done)
        self._b.position_at_end(body)
        index = self._b.phi(integer)
        self._sample = self._b.mul(index, integer(self._function.numel_in(1)))
        # All is computed before the state is overwritten.
        next_state, output = self._instructions()
        for i, value in next_state.items():
            self._store(value, self._arrays[0], integer(i))
        offset = self._b.mul(index, integer(self._function.numel_out(1)))
        for i, value in output.items():
            self._store(value, self._arrays[_OUTPUT], self._b.add(offset, integer(i)))
        index_next = self._b.add(index, one)
        index.add_incoming(zero, entry)
        index.add_incoming(index_next, body)
        self._b.cbranch(self._b.icmp_signed("<", index_next, count), body, done)
        self._b.position_at_end(done)
        self._b.ret_void()
        self._single(run)
        return self._module

    def _single(self, run: Any) -> None:
        """Add the function of one sample, with all addresses in one array.

        An argument less to convert is a tenth of a microsecond.
        """
        ir = self._ir
        place, one = self._double.as_pointer(), ir.IntType(_BITS)(1)
        signature = ir.FunctionType(ir.VoidType(), [place.as_pointer()])
        single = ir.Function(self._module, signature, name="single")
        b = ir.IRBuilder(single.append_basic_block("entry"))
        places = [b.load(b.gep(single.args[0], [ir.IntType(_BITS)(i)])) for i in range(_POINTERS)]
        b.call(run, [one, *places])
        b.ret_void()

    def _instructions(self) -> tuple[dict[int, Any], dict[int, Any]]:
        """Return the values of next state and output, by their place; every input is read before anything is
        written."""
        f, values = self._function, {}
        results: tuple[dict[int, Any], dict[int, Any]] = ({}, {})
        for k in range(f.n_instructions()):
            name = self._names[f.instruction_id(k)]
            arguments, targets = f.instruction_input(k), f.instruction_output(k)
            if name == "OP_CONST":
                values[targets[0]] = self._constant(f.instruction_constant(k))
            elif name == "OP_INPUT":
                values[targets[0]] = self._input(*arguments)
            elif name == "OP_OUTPUT":
                results[targets[0]][targets[1]] = values[arguments[0]]
            else:
                values[targets[0]] = self._operation(name, [values[i] for i in arguments])
        for which, values_of_output in enumerate(results):
            for i in range(f.numel_out(which)):
                values_of_output.setdefault(i, self._constant(0.0))
        return results

    def _constant(self, value: float) -> Any:
        return self._ir.Constant(self._double, value)

    def _store(self, value: Any, array: Any, place: Any) -> None:
        self._b.store(value, self._b.gep(array, [place]), align=_BYTES)

    def _input(self, which: int, place: int) -> Any:
        start = self._ir.IntType(_BITS)(place)
        if which == 1:
            start = self._b.add(self._sample, start)
        return self._b.load(self._b.gep(self._arrays[which], [start]), align=_BYTES)

    def _operation(self, name: str, x: list[Any]) -> Any:
        """Return the value of one instruction with its arguments; raises Untranslatable for one that is not known."""
        b, one, zero = self._b, self._constant(1.0), self._constant(0.0)
        simple: dict[str, Callable[[], Any]] = {
            "OP_ADD": lambda: b.fadd(*x),
            "OP_SUB": lambda: b.fsub(*x),
            "OP_MUL": lambda: b.fmul(*x),
            "OP_DIV": lambda: b.fdiv(*x),
            "OP_NEG": lambda: b.fneg(x[0]),
            "OP_SQ": lambda: b.fmul(x[0], x[0]),
            "OP_TWICE": lambda: b.fadd(x[0], x[0]),
            "OP_INV": lambda: b.fdiv(one, x[0]),
            "OP_ASSIGN": lambda: x[0],
            "OP_NE": lambda: b.select(b.fcmp_unordered("!=", *x), one, zero),
            "OP_NOT": lambda: b.select(b.fcmp_ordered("==", x[0], zero), one, zero),
            "OP_AND": lambda: b.select(b.and_(self._true(x[0]), self._true(x[1])), one, zero),
            "OP_OR": lambda: b.select(b.or_(self._true(x[0]), self._true(x[1])), one, zero),
            "OP_IF_ELSE_ZERO": lambda: b.select(self._true(x[0]), x[1], zero),
            "OP_FMAX": lambda: self._extreme("<", x),
            "OP_FMIN": lambda: self._extreme(">", x),
            "OP_SIGN": lambda: self._sign(x[0]),
        }
        if name in simple:
            return simple[name]()
        if name in COMPARISONS:
            return b.select(b.fcmp_ordered(COMPARISONS[name], *x), one, zero)
        if name in INTRINSICS:
            return b.call(self._intrinsic(INTRINSICS[name]), x)
        if name in LIBRARY:
            return self._call(LIBRARY[name], x)
        raise Untranslatable(f"the step uses {name}, which the LLVM kernel does not know")

    def _intrinsic(self, name: str) -> Any:
        full = f"llvm.{name}.f64"
        if full not in self._declared:
            signature = self._ir.FunctionType(self._double, [self._double])
            self._declared[full] = self._ir.Function(self._module, signature, name=full)
        return self._declared[full]

    def _true(self, value: Any) -> Any:
        """Return True if a number is not 0; NaN counts as true."""
        return self._b.fcmp_unordered("!=", value, self._constant(0.0))

    def _sign(self, value: Any) -> Any:
        """Return 1, -1, or the argument itself where it is 0 or NaN."""
        b, zero = self._b, self._constant(0.0)
        positive = b.select(b.fcmp_ordered(">", value, zero), self._constant(1.0), value)
        return b.select(b.fcmp_ordered("<", value, zero), self._constant(-1.0), positive)

    def _extreme(self, order: str, x: list[Any]) -> Any:
        """Return fmax or fmin as CasADi evaluates them: the first of two equals, and the number where the other
        is NaN."""
        b = self._b
        chosen = b.select(b.fcmp_ordered(order, x[0], x[1]), x[1], x[0])
        return b.select(b.fcmp_unordered("uno", x[0], x[0]), x[1], chosen)

    def _call(self, name: str, x: list[Any]) -> Any:
        ir, b = self._ir, self._b
        if name not in self._declared:
            signature = ir.FunctionType(self._double, [self._double] * len(x))
            self._declared[name] = ir.Function(self._module, signature, name=f"palpate_{name}")
        return b.call(self._declared[name], x)


@cache
def operations() -> dict[int, str]:
    """Return the names of CasADi's instructions, by their number."""
    import casadi

    return {getattr(casadi, name): name for name in dir(casadi) if name.startswith("OP_")}
