"""Process models: how the tip moves in contact, for filters of any kind and contact models of any kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import factorial
from typing import Any

from palpate.contact import ContactModel, contact_force


def advance_memory(
    model: ContactModel,
    before: tuple[Any, Any],
    after: tuple[Any, Any],
    theta: Sequence[Any],
    memory: Sequence[Any],
    interval: Any,
) -> list[Any]:
    """The model's internal states one interval [s] later, on the way from one (depth, rate) to another.

    The midpoint rule: second order in the interval, and one expression for floats and CasADi symbols.
    """
    if not model.memory:
        return []
    slopes = model.memory_rate(before[0], before[1], theta, memory)
    halfway = [value + 0.5 * interval * slope for value, slope in zip(memory, slopes, strict=True)]
    depth, rate = 0.5 * (before[0] + after[0]), 0.5 * (before[1] + after[1])
    slopes = model.memory_rate(depth, rate, theta, halfway)
    return [value + interval * slope for value, slope in zip(memory, slopes, strict=True)]


@dataclass(frozen=True)
class InertialProcess:
    """The tip's mass between sensor and contact: force is the input, velocity the measurement.

    State: depth d [m], its rate [m/s], the contact model's internal states, its parameters, and their time derivatives
    up to the evolution order, all first ones before all second ones. Between two samples

        d     <- d + T d' + T^2/(2 m) (u - F(d, d'))
        d'    <- d' + T/m (u - F(d, d'))

    with the measured force u, so that force noise of standard deviation sigma_u enters as Q = B sigma_u^2 B^T with
    B = [T^2/(2 m), T/m] (paper, eqs. state_space_NL_FT, model_unc). Parameters are constant at order 0, and follow
    their Taylor series at a higher one; order 2 is the paper's expanded state (eq. state_space_NL_FT_plus). SI here;
    the paper writes it in mm.
    """

    model: ContactModel
    mass: Any  # [kg]
    order: int = 0

    @property
    def states(self) -> int:
        """Length of the state."""
        return 2 + len(self.model.memory) + (1 + self.order) * len(self.model.parameters)

    @property
    def parameters(self) -> slice:
        """Where the contact model's parameters stand in the state."""
        first = 2 + len(self.model.memory)
        return slice(first, first + len(self.model.parameters))

    def force(self, state: Sequence[Any]) -> Any:
        """Contact force [N] in a state."""
        first = self.parameters.start
        return contact_force(self.model, state[0], state[1], state[self.parameters], state[2:first])

    def predict(self, state: Sequence[Any], force: Any, interval: Any) -> list[Any]:
        """The state one interval [s] later under a measured force [N]."""
        to_depth, to_rate = self.gain(interval)
        excess = force - self.force(state)
        depth = state[0] + interval * state[1] + to_depth * excess
        rate = state[1] + to_rate * excess
        first = self.parameters.start
        theta, memory = state[self.parameters], state[2:first]
        remembered = advance_memory(self.model, (state[0], state[1]), (depth, rate), theta, memory, interval)
        return [depth, rate, *remembered, *self._evolved(state[first:], interval)]

    def _evolved(self, chain: Sequence[Any], interval: Any) -> list[Any]:
        """Parameters and their derivatives one interval [s] later."""
        count, evolved = len(self.model.parameters), []
        for i in range(len(chain)):
            value = chain[i]
            for k, j in enumerate(range(i + count, len(chain), count), start=1):
                value = value + interval**k / factorial(k) * chain[j]
            evolved.append(value)
        return evolved

    def gain(self, interval: Any) -> tuple[Any, Any]:
        """B: what one newton adds to depth [m/N] and rate [m/s/N] over an interval [s]."""
        return interval**2 / (2 * self.mass), interval / self.mass
