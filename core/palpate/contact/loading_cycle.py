"""Loading cycles: an ability of models whose force in unloading does not follow from the depth alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from palpate.contact.interfaces import ContactModel
from palpate.vectors import Floats


@runtime_checkable
class LoadingCycle(Protocol):
    """Ability of a contact model to give its force over one loading and one unloading."""

    def loading_cycle_force(self, time: Floats, depth: Floats, theta: Sequence[float], reversal: float) -> Floats:
        """Return force (n,) [N] at instants (n,) [s] and depths (n,) [m]; steps back of up to `reversal` [m] are noise.

        Raises ValueError where the depth has more than one maximum.
        """
        ...


def loading_cycle_force(
    model: ContactModel, time: Floats, depth: Floats, theta: Sequence[float], reversal: float = 1e-6
) -> Floats:
    """Return force (n,) [N] of a model over one loading and one unloading; raises ValueError where it is not known.

    Steps back of up to `reversal` [m] are noise: 1 um by default, a choice.
    """
    if not isinstance(model, LoadingCycle):
        name = type(model).__name__
        raise ValueError(f"Ting's unloading needs a linear material with a relaxation modulus, not {name}")
    return model.loading_cycle_force(time, depth, theta, reversal)
