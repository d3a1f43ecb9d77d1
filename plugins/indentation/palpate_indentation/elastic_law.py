"""The elastic law of a contact model, per unit of its modulus, with all other parameters held."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from palpate import ConfigurationError, ContactModel, Floats, contact_force, suggest, to_si

_TEST_DEPTHS = (0.1, 0.2)  # of the reach (0231): at these the force is tested for proportionality to the modulus
_DEFAULT_REACH = 1e-2  # [m] of a robot's press, where no record states it
_PROPORTIONALITY = 1e-9  # relative, a choice: far above rounding, far below any nonlinearity of a model


@dataclass(frozen=True)
class ElasticLaw:
    """F = E G(d) + H(d, d') with the modulus E, the geometry G, force per modulus, and the held force H [N]."""

    model: ContactModel
    name: str  # of the modulus among the parameters
    unit: str  # of the modulus
    modulus_index: int  # of the modulus among the parameters
    held: tuple[float, ...]  # values of all parameters, with 0 for the modulus
    viscosity_index: int | None = None  # of the parameter that the force at speed is proportional to; None: none is
    stated: frozenset[str] = frozenset()  # names of the parameters whose value the user states
    adhesion: float = 0.0  # work of adhesion over modulus [m], of a model that is adhesive

    def geometry(self, depth: Floats) -> Floats:
        """Return G (n,), the force per modulus at rest, or on the way in, at depths (n,) [m]; 0 above the surface."""
        if self.model.adhesive:
            return np.asarray(contact_force(self.model, depth, np.ones(len(depth)), [1.0, self.adhesion]))
        theta = list(self.held)
        theta[self.modulus_index] = 1.0
        return self._force(depth, 0.0, theta) - self._force(depth, 0.0, self.held)

    def contact_geometry(self, depth: Floats) -> Floats:
        """Return the force per modulus (n,) at rest of an adhesive model whose tip touches at depths (n,) [m]."""
        theta = [1.0, self.adhesion]
        return np.asarray(self.model.force(np.maximum(depth, self.model.pull_off_depth(theta)), 0.0, theta))

    def held_force(self, depth: Floats, rate: Floats) -> Floats:
        """Return H (n,) [N], the force of the held parameters at depths (n,) [m] and rates (n,) [m/s]."""
        return self._force(depth, rate, self.held) if any(self.held) else np.zeros(len(depth))

    def damping(self, depth: Floats, rate: Floats) -> Floats:
        """Return the force (n,) per unit of the viscous parameter at depths (n,) [m] and rates (n,) [m/s]."""
        assert self.viscosity_index is not None
        theta = [0.0 if i == self.viscosity_index else value for i, value in enumerate(self.held)]
        force_without_viscosity = self._force(depth, rate, theta)
        theta[self.viscosity_index] = 1.0
        return self._force(depth, rate, theta) - force_without_viscosity

    @property
    def viscosity(self) -> tuple[str, float, str] | None:
        """Name, value and unit of the viscous parameter; None if the law has none."""
        if self.viscosity_index is None:
            return None
        parameter = self.model.parameters[self.viscosity_index]
        return parameter.name, self.held[self.viscosity_index], parameter.unit

    def with_viscosity(self, viscosity: float) -> ElasticLaw:
        """Return the same law with another value of the viscous parameter [SI]."""
        held = list(self.held)
        if self.viscosity_index is not None:
            held[self.viscosity_index] = viscosity
        return replace(self, held=tuple(held))

    def with_model(self, model: ContactModel) -> ElasticLaw:
        """Return the same law of another model that has the same parameters."""
        return replace(self, model=model)

    def _force(self, depth: Floats, rate: Any, theta: Sequence[float]) -> Floats:
        """Return the force (n,) [N] of the model by parameters (p,); 0 above the surface."""
        is_inside = depth > 0
        if not is_inside.any():
            return np.zeros(len(depth))
        # A depth that every model accepts stands in for those above the surface.
        safe_depth = np.where(is_inside, depth, float(depth.max()))
        return np.where(is_inside, self.model.force(safe_depth, rate, list(theta)) + 0.0 * safe_depth, 0.0)


def law_of(model: ContactModel, name: str, parameters: Mapping[str, str], reach: float = _DEFAULT_REACH) -> ElasticLaw:
    """Return the law of the model called `name` for presses of some reach [m], with the stated parameters.

    Raises ConfigurationError for a parameter that the model does not have or whose unit is another, and where the
    model's force at rest is not proportional to one modulus.
    """
    modulus_index = _elastic_index(model, name)
    held = _held_values(model, modulus_index, parameters)
    modulus = model.parameters[modulus_index]
    law = ElasticLaw(model, modulus.name, modulus.unit, modulus_index, tuple(held))

    # Twice the modulus has to make twice the force, at a tenth and a fifth of the reach.
    depths = reach * np.array(_TEST_DEPTHS)
    single, double = (
        law._force(depths, 0.0, [*held[:modulus_index], factor, *held[modulus_index + 1 :]])
        - law.held_force(depths, np.zeros(2))
        for factor in (1.0, 2.0)
    )
    if not np.allclose(double, 2.0 * single, rtol=_PROPORTIONALITY) or np.any(single <= 0):
        raise ConfigurationError(f"model {name}: its force at rest is not proportional to {modulus.name}")
    return replace(law, viscosity_index=_viscosity_index(law, depths), stated=frozenset(parameters))


def _elastic_index(model: ContactModel, name: str) -> int:
    """Return the index of the first elastic parameter of a model; raises ConfigurationError if it cannot be E."""
    elastic = [i for i, parameter in enumerate(model.parameters) if parameter.role == "elastic"]
    if model.adhesive or not elastic:
        raise ConfigurationError(
            f"model {name}: its force at rest is not proportional to a modulus, so it gives none over depth; take one "
            "such as dimensionality-reduction (adhesion is looked for in addition)"
        )
    return elastic[0]


def _held_values(model: ContactModel, modulus_index: int, stated: Mapping[str, str]) -> list[float]:
    """Return the values [SI] of all parameters of a model, with 0 for its modulus; raises ConfigurationError.

    A parameter that nobody states is 0 if it makes a force, as all with a role do; else its start value, or 1.
    """
    names = [parameter.name for parameter in model.parameters]
    held = [0.0] * len(names)
    for key, text in stated.items():
        if key not in names or key == names[modulus_index]:
            allowed = [other for other in names if other != names[modulus_index]]
            raise ConfigurationError(f"--parameter {key}: is not one of {', '.join(allowed)}{suggest(key, allowed)}")
        try:
            held[names.index(key)] = to_si(text, model.parameters[names.index(key)].unit)
        except ValueError as error:
            raise ConfigurationError(f"--parameter {key}: {error}") from error
    for i, parameter in enumerate(model.parameters):
        makes_force = parameter.role is not None or parameter.unit in ("Pa", "N", "N/m")
        if parameter.name not in stated and not makes_force:
            held[i] = parameter.start or 1.0
    return held


def _viscosity_index(law: ElasticLaw, depths: Floats) -> int | None:
    """Return the index of the viscous parameter to which the force at speed is proportional; None without one."""
    rates = depths  # of as many metres a second, a choice: a proportionality holds at any speed
    for i, parameter in enumerate(law.model.parameters):
        if parameter.role != "viscous":
            continue
        laws = [replace(law, viscosity_index=i).with_viscosity(viscosity) for viscosity in (0.0, 1.0, 2.0)]
        without, single, double = (viscous_law.held_force(depths, rates) for viscous_law in laws)
        is_linear = np.allclose(double - without, 2.0 * (single - without), rtol=_PROPORTIONALITY)
        if np.all(single > without) and is_linear:
            return i
    return None
