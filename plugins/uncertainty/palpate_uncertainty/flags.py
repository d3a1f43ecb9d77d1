"""Flags on values whose uncertainty is not declared, or which it could explain."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set

from palpate import ContactModel, Flag, Floats

_MILLISECOND = 1e-3  # [s]
_HARDLY = 0.01  # of a parameter
_BARELY = 0.001  # of a parameter
_OFFSET = 0.01  # [N]


def timing_flags(
    model: ContactModel,
    values: Floats,
    shifts: Floats,
    uncertainty: float | None,
    held: Set[str] = frozenset(),
) -> Iterator[Flag]:
    """Parameters that a force or motion recorded late would shift, against the declared timing uncertainty [s].

    `shifts` (k,) are those of `delay_shifts`. Left out: what is `held` fixed, and what is not viscous and moves by
    less than a hundredth in 1 ms.
    """
    for parameter, value, shift in zip(model.parameters, values.tolist(), shifts.tolist(), strict=True):
        if not shift or parameter.name in held:
            continue
        if parameter.role != "viscous" and abs(shift) * _MILLISECOND <= _HARDLY * abs(value):
            continue
        if uncertainty is None:
            per_ms = f"{abs(shift) * _MILLISECOND:.3g} {parameter.unit}"
            yield Flag("timing-undeclared", f"no timing uncertainty is declared; 1 ms is {per_ms} of {parameter.name}")
        elif abs(value) < 2 * abs(shift) * uncertainty:
            yield Flag(
                "not-distinguishable-from-delay", f"{parameter.name} is within {uncertainty * 1e3:.3g} ms of none"
            )


def tare_flags(model: ContactModel, values: Floats, shifts: Floats | None) -> Iterator[Flag]:
    """Elastic parameters that an offset of the force would shift; `shifts` (k,) per newton.

    Left out: what moves by less than a thousandth in 10 mN.
    """
    if shifts is None:
        return
    moved = [
        f"{abs(shift) * _OFFSET:.3g} {parameter.unit} of {parameter.name}"
        for parameter, value, shift in zip(model.parameters, values.tolist(), shifts.tolist(), strict=True)
        if parameter.role == "elastic" and abs(shift) * _OFFSET > _BARELY * abs(value)
    ]
    if moved:
        yield Flag("tare-undeclared", f"no uncertainty of the tare is declared; 10 mN are {', '.join(moved)}")


def compliance_flags(shares: Mapping[str, float], stiffness: float | None) -> Iterator[Flag]:
    """Parameters that a robot which gives way shifts by more than a hundredth; `shares` of their values by name."""
    strong = [f"{name} by {100 * share:.2g} %" for name, share in shares.items() if share > _HARDLY]
    if stiffness is not None and strong:
        yield Flag(
            "series-compliance",
            f"robot and sensor have a stiffness of {1e-3 * stiffness:.3g} N/mm, which shifts "
            f"{', '.join(strong)}; it is not corrected",
        )
