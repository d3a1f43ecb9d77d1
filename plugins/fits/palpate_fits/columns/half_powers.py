"""Powers of one and a half, and the like, by square roots: a tenth of the time of the C library's `pow`."""

from __future__ import annotations

from typing import Any

_HIGHEST = 4.5


def with_roots(function: Any) -> Any:
    """Return a CasADi function of symbols (SX) with each power of -4.5, -3.5 .. 4.5 as a product with a square root."""
    import casadi
    from palpate_kit.kernel.translation import operations

    names = operations()
    inputs = [casadi.SX.sym(f"i{k}", function.numel_in(k)) for k in range(function.n_in())]
    outputs = [casadi.SX.zeros(function.numel_out(k)) for k in range(function.n_out())]
    known: dict[int, Any] = {}
    constants: dict[int, float] = {}
    for k in range(function.n_instructions()):
        code, places, targets = (
            function.instruction_id(k),
            function.instruction_input(k),
            function.instruction_output(k),
        )
        name = names[code]
        if name == "OP_OUTPUT":
            outputs[targets[0]][targets[1]] = known[places[0]]
            continue
        target = targets[0]
        constant = float(function.instruction_constant(k)) if name == "OP_CONST" else None
        if constant is not None:
            known[target] = casadi.SX(constant)
        elif name == "OP_INPUT":
            known[target] = inputs[places[0]][places[1]]
        elif name in ("OP_POW", "OP_CONSTPOW") and _half(constants.get(places[1])):
            known[target] = _power(known[places[0]], constants[places[1]])
        elif len(places) == 1:
            known[target] = casadi.SX.unary(code, known[places[0]])
        else:
            known[target] = casadi.SX.binary(code, *(known[place] for place in places))
        constants.pop(target, None)  # places are used again
        if constant is not None:
            constants[target] = constant
    return casadi.Function(function.name(), inputs, [casadi.densify(one) for one in outputs], {"cse": True})


def _half(exponent: float | None) -> bool:
    return exponent is not None and abs(exponent) <= _HIGHEST and (2.0 * exponent) % 2.0 == 1.0


def _power(base: Any, exponent: float) -> Any:
    root = base**0.5
    whole = int(abs(exponent))
    product = root
    for _ in range(whole):
        product = product * base
    return product if exponent > 0 else 1.0 / product
