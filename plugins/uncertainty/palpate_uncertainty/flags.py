"""Flags on values whose uncertainty is not declared, or which it could explain."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set

from palpate import ContactModel, Flag, Floats

_HARDLY = 0.01  # of a parameter
OFFSET = 0.01  # [N] standard uncertainty of a zero of which none is declared


def timing_flags(
    model: ContactModel,
    values: Floats,
    shifts: Floats,
    uncertainty: float | None,
    interval: float,
    held: Set[str] = frozenset(),
) -> Iterator[Flag]:
    """Parameters that a force or motion recorded late would shift, against the declared timing uncertainty [s].

    `shifts` (k,) are those of `delay_shifts`. Where none is declared, the effect is that of one `interval` [s] between
    two samples.
    """
    moved = {
        parameter.name: abs(shift)
        for parameter, shift in zip(model.parameters, shifts.tolist(), strict=True)
        if shift and parameter.name not in held
    }
    if not moved:
        return
    if uncertainty is None:
        effects = {name: shift * interval for name, shift in moved.items()}
        text = f"no timing uncertainty is declared; a delay of one sample is {1e3 * interval:.2g} ms"
        yield Flag("timing-undeclared", text, effects=effects, causes=("timing",))
        return
    value = {parameter.name: one for parameter, one in zip(model.parameters, values.tolist(), strict=True)}
    if within := [name for name, shift in moved.items() if abs(value[name]) < 2 * shift * uncertainty]:
        effects = {name: moved[name] * uncertainty for name in within}
        text = f"{', '.join(within)} within {uncertainty * 1e3:.3g} ms of none"
        yield Flag("not-distinguishable-from-delay", text, effects=effects, causes=("timing",))


def tare_flags(model: ContactModel, shifts: Floats | None) -> Iterator[Flag]:
    """Parameters that an undeclared offset of the force would shift; `shifts` (k,) per newton."""
    if shifts is not None:
        names = [parameter.name for parameter in model.parameters]
        effects = {name: abs(shift) * OFFSET for name, shift in zip(names, shifts.tolist(), strict=True)}
        text = f"no uncertainty of the tare is declared or measured; {1e3 * OFFSET:.0f} mN are assumed"
        yield Flag("tare-undeclared", text, effects=effects, causes=("tare",))


def compliance_flags(shares: Mapping[str, float], stiffness: float | None) -> Iterator[Flag]:
    """Parameters that a robot which gives way shifts by more than a hundredth; `shares` of their values by name."""
    strong = [f"{name} by {100 * share:.2g} %" for name, share in shares.items() if share > _HARDLY]
    if stiffness is not None and strong:
        yield Flag(
            "series-compliance",
            f"robot and sensor have a stiffness of {1e-3 * stiffness:.3g} N/mm, which shifts "
            f"{', '.join(strong)}; it is not corrected",
        )
