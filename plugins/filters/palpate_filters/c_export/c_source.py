"""From CasADi's instructions to C99: the same list that the LLVM kernel compiles, one statement for each of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from palpate_kit.kernel.translation import COMPARISONS, INTRINSICS, LIBRARY, Untranslatable, operations

_PLAIN: dict[str, Callable[..., str]] = {
    "OP_ADD": lambda a, b: f"{a} + {b}",
    "OP_SUB": lambda a, b: f"{a} - {b}",
    "OP_MUL": lambda a, b: f"{a} * {b}",
    "OP_DIV": lambda a, b: f"{a} / {b}",
    "OP_NEG": lambda a: f"-{a}",
    "OP_SQ": lambda a: f"{a} * {a}",
    "OP_TWICE": lambda a: f"{a} + {a}",
    "OP_INV": lambda a: f"1.0 / {a}",
    "OP_ASSIGN": lambda a: a,
    "OP_NE": lambda a, b: f"({a} != {b}) ? 1.0 : 0.0",
    "OP_NOT": lambda a: f"({a} == 0.0) ? 1.0 : 0.0",
    "OP_AND": lambda a, b: f"({a} != 0.0 && {b} != 0.0) ? 1.0 : 0.0",
    "OP_OR": lambda a, b: f"({a} != 0.0 || {b} != 0.0) ? 1.0 : 0.0",
    "OP_IF_ELSE_ZERO": lambda a, b: f"({a} != 0.0) ? {b} : 0.0",
    "OP_SIGN": lambda a: f"({a} > 0.0) ? 1.0 : (({a} < 0.0) ? -1.0 : {a})",
    # As CasADi evaluates them: the first of two equals, and the number where the other is NaN.
    "OP_FMAX": lambda a, b: f"({a} < {b} || {a} != {a}) ? {b} : {a}",
    "OP_FMIN": lambda a, b: f"({a} > {b} || {a} != {a}) ? {b} : {a}",
}
# Divisions are distinguished by the counters.
CHEAP = frozenset({*_PLAIN, *COMPARISONS, "OP_FABS"})


def c_function(name: str, function: Any, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> str:
    """Return a CasADi function of vectors as a static C function of arrays; it reads all inputs before it writes.

    Raises Untranslatable for an instruction that has no counterpart in C99.
    """
    lines: list[str] = []
    values: dict[int, str] = {}  # C name, or number, of each register that the instructions write
    output_values: dict[tuple[int, int], str] = {}  # by output and entry
    used_inputs: set[int] = set()

    def assign(register: int, expression: str) -> None:
        """Add a statement that gives a register's value a name of its own."""
        values[register] = f"v{len(lines)}"
        lines.append(f"    const double v{len(lines)} = {expression};")

    # One statement for each instruction, by CasADi's name of its operation; constants and outputs stand in those of
    # others.
    names = operations()
    for k in range(function.n_instructions()):
        operation = names[function.instruction_id(k)]
        arguments, targets = function.instruction_input(k), function.instruction_output(k)
        if operation == "OP_CONST":
            values[targets[0]] = c_number(function.instruction_constant(k))
        elif operation == "OP_INPUT":
            used_inputs.add(arguments[0])
            assign(targets[0], f"{inputs[arguments[0]]}[{arguments[1]}]")
        elif operation == "OP_OUTPUT":
            output_values[targets[0], targets[1]] = values[arguments[0]]
        else:
            assign(targets[0], _expression(operation, [values[i] for i in arguments]))
    # Outputs last, so that an array may be input and output; an entry that no instruction writes is 0.
    for index, array in enumerate(outputs):
        for entry in range(function.numel_out(index)):
            lines.append(f"    {array}[{entry}] = {output_values.get((index, entry), '0.0')};")
    # A compiler warns of an argument without a use.
    lines += [f"    (void){array};" for i, array in enumerate(inputs) if i not in used_inputs]
    arguments_text = ", ".join(
        [*(f"const double *{array}" for array in inputs), *(f"double *{array}" for array in outputs)]
    )
    return "\n".join([f"static void {name}({arguments_text})", "{", *lines, "}", ""])


def _expression(operation: str, x: list[str]) -> str:
    """Return the C expression of an operation on operands; raises Untranslatable where C99 has none."""
    if operation in _PLAIN:
        return _PLAIN[operation](*x)
    if operation in COMPARISONS:
        return f"({x[0]} {COMPARISONS[operation]} {x[1]}) ? 1.0 : 0.0"
    function = INTRINSICS.get(operation) or LIBRARY.get(operation)
    if function is None:
        raise Untranslatable(f"the step uses {operation}, which C99 has no counterpart of")
    return f"{function}({', '.join(x)})"


def c_number(value: float) -> str:
    """Return a constant of C that is this number to the bit; a negative one in brackets."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "HUGE_VAL" if value > 0 else "(-HUGE_VAL)"
    text = repr(float(value))
    return f"({text})" if text.startswith("-") else text
