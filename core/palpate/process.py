"""Process models: how the tip moves in contact, for filters of any kind and contact models of any kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from palpate.contact import ContactModel, contact_force


@dataclass(frozen=True)
class InertialProcess:
    """The tip's mass between sensor and contact: force is the input, velocity the measurement.

    State: depth d [m], its rate [m/s], the contact model's internal states, which follow its `memory_rate`, and its
    parameters, which are constant. Between two samples

        d     <- d + T d' + T^2/(2 m) (u - F(d, d'))
        d'    <- d' + T/m (u - F(d, d'))

    with the measured force u, so that force noise of standard deviation sigma_u enters as Q = B sigma_u^2 B^T with
    B = [T^2/(2 m), T/m] (paper, eqs. state_space_NL_FT, model_unc). SI here; the paper writes it in mm.
    """

    model: ContactModel
    mass: Any  # [kg]

    def force(self, state: Sequence[Any]) -> Any:
        """Contact force [N] in a state."""
        memory, theta = self.split(state)
        return contact_force(self.model, state[0], state[1], theta, memory)

    def split(self, state: Sequence[Any]) -> tuple[Sequence[Any], Sequence[Any]]:
        """The internal states and the parameters in a state."""
        first = 2 + len(self.model.memory)
        return state[2:first], state[first:]

    def remembered(self, state: Sequence[Any], interval: Any) -> list[Any]:
        """The internal states one interval [s] later: a step of Heun's method along a straight motion."""
        memory, theta = self.split(state)
        if not len(memory):
            return []
        depth, rate = state[0], state[1]
        first = self.model.memory_rate(depth, rate, theta, memory)
        guess = [m + interval * change for m, change in zip(memory, first, strict=True)]
        second = self.model.memory_rate(depth + interval * rate, rate, theta, guess)
        return [m + interval / 2 * (a + b) for m, a, b in zip(memory, first, second, strict=True)]

    def predict(self, state: Sequence[Any], force: Any, interval: Any) -> list[Any]:
        """The state one interval [s] later under a measured force [N]."""
        to_depth, to_rate = self.gain(interval)
        excess = force - self.force(state)
        depth = state[0] + interval * state[1] + to_depth * excess
        _, theta = self.split(state)
        return [depth, state[1] + to_rate * excess, *self.remembered(state, interval), *theta]

    def gain(self, interval: Any) -> tuple[Any, Any]:
        """B: what one newton adds to depth [m/N] and rate [m/s/N] over an interval [s]."""
        return interval**2 / (2 * self.mass), interval / self.mass
