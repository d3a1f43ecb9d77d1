"""The elastic law of a contact model, per unit of its modulus, with everything else of it held."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from palpate import ConfigurationError, ContactModel, Floats, contact_force, suggest, to_si

_TEST = (0.1, 0.2)  # of the reach: depths at which it is looked whether a force is proportional to its modulus
_REACH = 1e-2  # [m] of a robot's press, where no record says it


@dataclass(frozen=True)
class ElasticLaw:
    """F = E G(d) + H(d, d') with the modulus E, the geometry G, force per modulus, and what is held, H [N]."""

    model: ContactModel
    name: str  # of the parameter that is looked for
    unit: str
    place: int
    held: tuple[float, ...]  # values of all parameters, with 0 for it
    viscous: int | None = None  # place of the parameter that the force at speed is proportional to; None: none is
    stated: frozenset[str] = frozenset()  # names of the parameters whose value was given
    adhesion: float = 0.0  # work of adhesion over modulus [m], of a model that is adhesive

    def geometry(self, depth: Floats) -> Floats:
        """(n,) force per modulus at rest, or on the way in, at depths (n,) [m]; 0 above the surface."""
        if self.model.adhesive:
            return np.asarray(contact_force(self.model, depth, np.ones(len(depth)), [1.0, self.adhesion]))
        unit = list(self.held)
        unit[self.place] = 1.0
        return self._force(depth, 0.0, unit) - self._force(depth, 0.0, self.held)

    def stuck(self, depth: Floats) -> Floats:
        """(n,) force per modulus at rest of an adhesive model whose tip touches at these depths (n,) [m]."""
        unit = [1.0, self.adhesion]
        return np.asarray(self.model.force(np.maximum(depth, self.model.pull_off_depth(unit)), 0.0, unit))

    def rest(self, depth: Floats, rate: Floats) -> Floats:
        """(n,) [N] what the held parameters make of depth and rate."""
        return self._force(depth, rate, self.held) if any(self.held) else np.zeros(len(depth))

    def damping(self, depth: Floats, rate: Floats) -> Floats:
        """(n,) force per unit of the viscous parameter at depths (n,) [m] and rates (n,) [m/s]."""
        assert self.viscous is not None
        unit = [0.0 if i == self.viscous else value for i, value in enumerate(self.held)]
        without = self._force(depth, rate, unit)
        unit[self.viscous] = 1.0
        return self._force(depth, rate, unit) - without

    @property
    def viscosity(self) -> tuple[str, float, str] | None:
        """Name, value and unit of the viscous parameter; None if it has none."""
        if self.viscous is None:
            return None
        parameter = self.model.parameters[self.viscous]
        return parameter.name, self.held[self.viscous], parameter.unit

    def with_viscosity(self, value: float) -> ElasticLaw:
        """Return the same with another value of the viscous parameter."""
        held = tuple(value if i == self.viscous else old for i, old in enumerate(self.held))
        return replace(self, held=held)

    def _force(self, depth: Floats, rate: Any, theta: Sequence[float]) -> Floats:
        inside = depth > 0
        if not inside.any():
            return np.zeros(len(depth))
        safe = np.where(inside, depth, float(depth.max()))
        return np.where(inside, self.model.force(safe, rate, list(theta)) + 0.0 * safe, 0.0)

    def with_model(self, model: ContactModel) -> ElasticLaw:
        """Return the same of another model that has the same parameters."""
        return replace(self, model=model)


def law_of(model: ContactModel, name: str, parameters: Mapping[str, str], reach: float = _REACH) -> ElasticLaw:
    """Return the law of a model for presses of some reach [m].

    Raises ConfigurationError where its force at rest is not proportional to one modulus.
    """
    names = [parameter.name for parameter in model.parameters]
    elastic = [i for i, parameter in enumerate(model.parameters) if parameter.role == "elastic"]
    if model.adhesive or not elastic:
        raise ConfigurationError(
            f"model {name}: its force at rest is not proportional to a modulus, so it gives none over depth; take one "
            "such as dimensionality-reduction (adhesion is looked for in addition)"
        )
    place, held = elastic[0], [0.0] * len(names)
    for key, text in parameters.items():
        if key not in names or key == names[place]:
            allowed = [other for other in names if other != names[place]]
            raise ConfigurationError(f"--parameter {key}: is not one of {', '.join(allowed)}{suggest(key, allowed)}")
        try:
            held[names.index(key)] = to_si(text, model.parameters[names.index(key)].unit)
        except ValueError as error:
            raise ConfigurationError(f"--parameter {key}: {error}") from error
    for i, parameter in enumerate(model.parameters):
        if parameter.name not in parameters and parameter.role is None:
            held[i] = parameter.start or 1.0
            if parameter.unit in ("Pa", "N", "N/m"):
                held[i] = 0.0
    law = ElasticLaw(model, names[place], model.parameters[place].unit, place, tuple(held))
    depths = reach * np.array(_TEST)
    once, twice = (
        law._force(depths, 0.0, [*held[:place], factor, *held[place + 1 :]]) - law.rest(depths, np.zeros(2))
        for factor in (1.0, 2.0)
    )
    if not np.allclose(twice, 2.0 * once, rtol=1e-9) or np.any(once <= 0):
        raise ConfigurationError(f"model {name}: its force at rest is not proportional to {names[place]}")
    return replace(law, viscous=_viscous_place(law, depths), stated=frozenset(parameters))


def _viscous_place(law: ElasticLaw, depths: Floats) -> int | None:
    """Return the parameter to which what the speed adds to the force is proportional, whatever the modulus."""
    for i, parameter in enumerate(law.model.parameters):
        if parameter.role == "viscous":
            laws = (replace(law, viscous=i).with_viscosity(value) for value in (0.0, 1.0, 2.0))
            none, one, two = (other.rest(depths, depths) for other in laws)  # at as many metres a second
            if np.all(one > none) and np.allclose(two - none, 2.0 * (one - none), rtol=1e-9):
                return i
    return None
