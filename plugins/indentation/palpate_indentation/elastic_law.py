"""The elastic law of a contact model, per unit of its modulus, with everything else of it held."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import ConfigurationError, ContactModel, Floats, to_si
from palpate.host import suggest

_TEST = (1e-3, 2e-3)  # [m] depths at which it is looked whether a force is proportional to its modulus


@dataclass(frozen=True)
class ElasticLaw:
    """F = E G(d) + H(d, d') with the modulus E, the geometry G, force per modulus, and what is held, H [N]."""

    model: ContactModel
    name: str  # of the parameter that is looked for
    unit: str
    place: int
    held: tuple[float, ...]  # values of all parameters, with 0 for it

    def geometry(self, depth: Floats) -> Floats:
        """(n,) force per modulus at rest at depths (n,) [m]; 0 above the surface."""
        unit = list(self.held)
        unit[self.place] = 1.0
        return self._force(depth, 0.0, unit) - self._force(depth, 0.0, self.held)

    def rest(self, depth: Floats, rate: Floats) -> Floats:
        """(n,) [N] what the held parameters make of depth and rate."""
        return self._force(depth, rate, self.held) if any(self.held) else np.zeros(len(depth))

    def _force(self, depth: Floats, rate: Any, theta: Sequence[float]) -> Floats:
        inside = depth > 0
        safe = np.where(inside, depth, 1.0e-3)
        return np.where(inside, self.model.force(safe, rate, list(theta)) + 0.0 * safe, 0.0)

    def with_model(self, model: ContactModel) -> ElasticLaw:
        """The same of another model that has the same parameters."""
        return ElasticLaw(model, self.name, self.unit, self.place, self.held)


def law_of(model: ContactModel, name: str, parameters: Mapping[str, str]) -> ElasticLaw:
    """The law of a model; raises ConfigurationError where its force at rest is not proportional to one modulus."""
    names = [parameter.name for parameter in model.parameters]
    elastic = [i for i, parameter in enumerate(model.parameters) if parameter.role == "elastic"]
    if model.adhesive or not elastic:
        raise ConfigurationError(
            f"model {name}: its force at rest is not proportional to a modulus, so there is none over depth; take one "
            "such as dimensionality-reduction (adhesion is looked for beside it)"
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
    depths = np.array(_TEST)
    once, twice = (
        law._force(depths, 0.0, [*held[:place], factor, *held[place + 1 :]]) - law.rest(depths, np.zeros(2))
        for factor in (1.0, 2.0)
    )
    if not np.allclose(twice, 2.0 * once, rtol=1e-9) or np.any(once <= 0):
        raise ConfigurationError(f"model {name}: its force at rest is not proportional to {names[place]}")
    return law
