"""Process models: the motion of the tip in contact, for filters of any kind and contact models of any kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import factorial
from typing import Any

from palpate import ContactModel, Layout, contact_force


def advance_memory(
    model: ContactModel,
    before: tuple[Any, Any],
    after: tuple[Any, Any],
    theta: Sequence[Any],
    memory: Sequence[Any],
    interval: Any,
) -> list[Any]:
    """Return the model's internal states one interval [s] later, on the way from one (depth, rate) to another.

    The midpoint rule, by the rates of the memory halfway: second order in the interval, and one expression for floats
    and CasADi symbols. `theta` are the model's parameters.
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

    @cached_property
    def layout(self) -> Layout:
        """The layout of the state: depth, rate, memory, parameters and their derivatives."""
        count = len(self.model.parameters)
        return Layout(depth=1, rate=1, memory=len(self.model.memory), parameters=count, derivatives=self.order * count)

    @property
    def states(self) -> int:
        """Length of the state."""
        return self.layout.size

    @property
    def parameters(self) -> slice:
        """The contact model's parameters in the state."""
        return self.layout["parameters"]

    def force(self, state: Sequence[Any]) -> Any:
        """Return the contact force [N] in a state."""
        depth, rate = state[self.layout.at("depth")], state[self.layout.at("rate")]
        return contact_force(self.model, depth, rate, state[self.parameters], state[self.layout["memory"]])

    def predict(self, state: Sequence[Any], force: Any, interval: Any) -> list[Any]:
        """Return the state one interval [s] later under a measured force [N]."""
        return self.advance(state, force - self.force(state), interval)

    def advance(self, state: Sequence[Any], excess: Any, interval: Any) -> list[Any]:
        """Return the state one interval [s] later, by the excess of the measured force over that of the contact [N].

        Linear in state and excess for a model without memory: the contact force alone is not.
        """
        to_depth, to_rate = self.gain(interval)
        before = state[self.layout.at("depth")], state[self.layout.at("rate")]
        depth = before[0] + interval * before[1] + to_depth * excess
        rate = before[1] + to_rate * excess
        theta, memory = state[self.parameters], state[self.layout["memory"]]
        memory_after = advance_memory(
            self.model, before, after=(depth, rate), theta=theta, memory=memory, interval=interval
        )
        chain = state[self.layout.span("parameters", "derivatives")]
        return [depth, rate, *memory_after, *self._evolve(chain, interval)]

    def _evolve(self, chain: Sequence[Any], interval: Any) -> list[Any]:
        """Return parameters and their derivatives one interval [s] later, each by its Taylor series."""
        count, evolved = len(self.model.parameters), []
        for i in range(len(chain)):
            value = chain[i]
            for k, j in enumerate(range(i + count, len(chain), count), start=1):
                value = value + interval**k / factorial(k) * chain[j]
            evolved.append(value)
        return evolved

    def gain(self, interval: Any) -> tuple[Any, Any]:
        """Return B = (T^2/(2 m), T/m): change of depth [m/N] and rate [m/s/N] by a force, constant over T [s]."""
        return interval**2 / (2 * self.mass), interval / self.mass


@dataclass(frozen=True)
class KinematicProcess:
    """The robot prescribes the tip's motion; position, velocity and force are measured, and the force is an output.

    State: height z [m] of the tip, its velocity and acceleration (driven by white jerk), height s [m] of the surface,
    on a sweep its slope along the path [m/s], a force bias [N] and its constant drift [N/s] if requested, the contact
    model's internal states, its parameters on a chart, and on a sweep the trend [1/s] of the first of them. Depth is
    s - z, the force sensor reads F(d, d') - m z'' + bias. The chart keeps signs: parameter 0 is exp(c_0), others that
    the force is proportional to are exp(c_0 + c_i), so that c_i is the logarithm of their ratio to it; what remains is
    exp(c_i) where its lower bound is not negative, else c_i itself.
    """

    model: ContactModel
    mass: Any  # [kg]
    sweeping: bool = False
    biased: bool = False
    drifting: bool = False  # only with `biased`

    @cached_property
    def layout(self) -> Layout:
        """The layout of the state."""
        return Layout(
            height=1,
            velocity=1,
            acceleration=1,
            surface=1,
            slope=int(self.sweeping),
            bias=int(self.biased),
            drift=int(self.drifting),
            memory=len(self.model.memory),
            chart=len(self.model.parameters),
            trend=int(self.sweeping),
        )

    @property
    def states(self) -> int:
        """Length of the state."""
        return self.layout.size

    @property
    def motion(self) -> slice:
        """Height, velocity and acceleration of the tip in the state."""
        return self.layout.span("height", "acceleration")

    @property
    def chart(self) -> slice:
        """The parameters, on their chart, in the state."""
        return self.layout["chart"]

    def depth(self, state: Sequence[Any]) -> Any:
        """Return the depth [m] of the tip below the surface."""
        return state[self.layout.at("surface")] - state[self.layout.at("height")]

    def rate(self, state: Sequence[Any]) -> Any:
        """Return the rate of the depth [m/s]."""
        slope = state[self.layout.at("slope")] if self.sweeping else 0.0
        return slope - state[self.layout.at("velocity")]

    def parameters(self, chart: Sequence[Any], exp: Any) -> list[Any]:
        """Return the contact model's parameters from their chart, with an exponential for this kind of number."""
        values = []
        for i, parameter in enumerate(self.model.parameters):
            if i and parameter.role is not None:
                values.append(exp(chart[0] + chart[i]))
            else:
                values.append(exp(chart[i]) if parameter.lower >= 0 else chart[i])
        return values

    def on_chart(self, theta: Sequence[float], log: Any) -> list[Any]:
        """Return the chart of parameters: the inverse of `parameters`."""
        chart = []
        for i, (parameter, value) in enumerate(zip(self.model.parameters, theta, strict=True)):
            if i and parameter.role is not None:
                chart.append(log(value) - log(theta[0]))
            else:
                chart.append(log(value) if parameter.lower >= 0 else value)
        return chart

    def contact(self, state: Sequence[Any], exp: Any) -> Any:
        """Return the contact force [N] in a state."""
        theta = self.parameters(state[self.chart], exp)
        memory = state[self.layout["memory"]]
        return contact_force(self.model, self.depth(state), self.rate(state), theta, memory, pulls=self.model.adhesive)

    def reading(self, state: Sequence[Any], exp: Any) -> Any:
        """Return the force sensor's reading [N] in a state, without noise."""
        force = self.contact(state, exp) - self.mass * state[self.layout.at("acceleration")]
        return force + state[self.layout.at("bias")] if self.biased else force

    def predict(self, state: Sequence[Any], interval: Any, exp: Any) -> list[Any]:
        """Return the state one interval [s] later; `exp` is that of floats or symbols, for the chart of logarithms."""
        # The motion at constant acceleration, then the levels that have a drift.
        at, after = self.layout.at, list(state)
        velocity, acceleration = state[at("velocity")], state[at("acceleration")]
        after[at("height")] = state[at("height")] + interval * velocity + 0.5 * interval**2 * acceleration
        after[at("velocity")] = velocity + interval * acceleration
        if self.sweeping:
            after[at("surface")] = state[at("surface")] + interval * state[at("slope")]
            after[self.chart.start] = state[self.chart.start] + interval * state[at("trend")]
        if self.drifting:
            after[at("bias")] = state[at("bias")] + interval * state[at("drift")]
        # Internal states follow the motion from one end of the interval to the other.
        theta, memory = self.parameters(state[self.chart], exp), self.layout["memory"]
        ends = [(self.depth(motion), self.rate(motion)) for motion in (state, after)]
        after[memory] = advance_memory(
            self.model, before=ends[0], after=ends[1], theta=theta, memory=state[memory], interval=interval
        )
        return after
