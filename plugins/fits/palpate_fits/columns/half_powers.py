"""Powers of one and a half, and the like, by square roots: a tenth of the time of the C library's `pow`."""

from __future__ import annotations

from typing import Any

_MAX_EXPONENT = 4.5  # up to which products are faster than `pow` (choice)


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
        arguments, targets = function.instruction_input(k), function.instruction_output(k)
        name = names[code]
        if name == "OP_OUTPUT":
            outputs[targets[0]][targets[1]] = registers[arguments[0]]
            continue
        register = targets[0]
        constant = float(function.instruction_constant(k)) if name == "OP_CONST" else None
        if constant is not None:
            registers[register] = casadi.SX(constant)
        elif name == "OP_INPUT":
            registers[register] = inputs[arguments[0]][arguments[1]]
        elif name in ("OP_POW", "OP_CONSTPOW") and _is_half_integer(constants.get(arguments[1])):
            registers[register] = _half_integer_power(registers[arguments[0]], constants[arguments[1]])
        elif len(arguments) == 1:
            registers[register] = casadi.SX.unary(code, registers[arguments[0]])
        else:
            registers[register] = casadi.SX.binary(code, *(registers[argument] for argument in arguments))
        constants.pop(register, None)
        if constant is not None:
            constants[register] = constant
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
