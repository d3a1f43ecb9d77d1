"""The interfaces of tips and of contact models."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Literal

from palpate.contact.expressions import select
from palpate.parts import Part
from palpate.vectors import Floats

_NODES = 8  # of Gauss-Legendre: exact for polynomials in t up to degree 15, so for k up to 12


class Indenter(Part, ABC):
    """A rigid axisymmetric tip by the method of dimensionality reduction (Popov and Hess 2015)."""

    kind: ClassVar[str] = "indenter"
    word: ClassVar[str] = ""  # by which people name it on a command line, where its type is called otherwise

    @property
    def sphere_radius(self) -> float | None:
        """The radius [m] of a tip that is a sphere, which touches alike on every inclination; None of another shape."""
        return None

    @abstractmethod
    def contact_radius(self, depth: Any) -> Any:
        """Return the contact radius a [m] at a depth d >= 0 [m]: the root of g(a) = d, g the reduced profile.

        Plain operators only, so that one expression runs on floats, arrays, complex numbers and CasADi symbols.
        """

    def profile_area(self, depth: Any) -> Any:
        """Return area A(d) [m^2] between tip and surface in the reduced plane: the integral of d - g(x) over 0..a(d).

        Since A' = a, it is the integral of `contact_radius`; by Gauss-Legendre in t with depth d t^4, which is exact
        for contact radii that are powers d^(k/4), k up to 12. Override it where a closed form exists.
        """
        return depth * sum(weight * self.contact_radius(depth * node) for node, weight in _quartic_nodes(_NODES))

    def validity(self, depth: float) -> str:
        """Return the assumption of this tip that fails at a depth [m], as a sentence; empty where all hold."""
        return ""


@cache
def _quartic_nodes(order: int) -> tuple[tuple[float, float], ...]:
    """Return t^4 and 4 t^3 times the weight of t, for Gauss-Legendre on 0..1."""
    import numpy as np

    nodes, weights = np.polynomial.legendre.leggauss(order)
    pairs = zip((nodes + 1) / 2, weights / 2, strict=True)
    return tuple((float(t**4), float(4 * t**3 * weight)) for t, weight in pairs)


@dataclass(frozen=True)
class Parameter:
    """One number that a contact model needs and an estimator looks for."""

    name: str  # "elasticity"
    symbol: str  # "E"
    unit: str  # SI: "Pa"
    meaning: str
    lower: float = 0.0
    upper: float = math.inf
    # "elastic": the force is proportional to it at rest; "viscous": the force per speed is proportional to it.
    role: Literal["elastic", "viscous"] | None = None
    start: float | None = None  # first guess, of the order that soft silicone and tissue have
    start_std: float | None = None  # how far off it may be

    def __post_init__(self) -> None:
        """Raise ValueError for a unit that is not a text, or an unknown role."""
        if not isinstance(self.unit, str):
            raise ValueError(f"parameter {self.name!r}: the unit is a text such as 'Pa', not {self.unit!r}")
        if self.role not in (None, "elastic", "viscous"):
            raise ValueError(f"parameter {self.name!r}: the role is 'elastic', 'viscous' or None, not {self.role!r}")

    @property
    def lowest_estimate(self) -> float:
        """The lower bound of least squares: none for a viscosity, so that those of an elastic material average to 0."""
        return -math.inf if self.role == "viscous" else self.lower


@dataclass(frozen=True)
class MaterialValue:
    """Elasticity or viscosity of the material, as a contact model's parameters imply it."""

    name: Literal["elasticity", "viscosity", "instant_elasticity"]  # E [Pa], eta [Pa*s], E before anything relaxed
    value: float
    gradient: tuple[float, ...]  # its derivative by each of the model's parameters
    caveat: str = ""  # what has to hold for it to be a property of the material

    @property
    def unit(self) -> str:
        """The SI unit."""
        return "Pa*s" if self.name == "viscosity" else "Pa"

    def std(self, parameter_std: Sequence[float]) -> float:
        """Return the standard deviation sqrt(sum_i (dv/dp_i s_i)^2) of v for uncorrelated parameters with s_i (k,)."""
        return math.hypot(*(slope * std for slope, std in zip(self.gradient, parameter_std, strict=True)))


class ContactModel(Part, ABC):
    """The force of a soft material on a tip, from depth, its rate, and the material's parameters."""

    kind: ClassVar[str] = "model"
    parameters: ClassVar[tuple[Parameter, ...]]
    memory: ClassVar[tuple[str, ...]] = ()  # names of internal states, for materials that relax
    # Groups of places in `parameters` that are interchangeable; they are ordered by rising last value.
    interchangeable: ClassVar[tuple[tuple[int, ...], ...]] = ()
    law_error: ClassVar[float] = 0.0  # of the force, how far it may be off the solution that its formula stands for
    adhesive: ClassVar[bool] = False  # it may pull, and its force at rest may fall with depth, from `pull_off_depth` on

    @classmethod
    def __pydantic_init_subclass__(cls, **settings: Any) -> None:
        """Raise TypeError where the parameters of a class are not a sequence of `Parameter`."""
        super().__pydantic_init_subclass__(**settings)
        parameters = vars(cls).get("parameters", ())
        is_sequence = isinstance(parameters, tuple | list)
        if not is_sequence or not all(isinstance(parameter, Parameter) for parameter in parameters):
            raise TypeError(f"{cls.__name__}.parameters is not a tuple of Parameter: {parameters!r}")

    @abstractmethod
    def force(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any] = ()) -> Any:
        """Return the force [N], positive where it pushes the tip out, at depth >= 0 [m] and its rate [m/s].

        `theta` holds one value for each of `parameters`, `memory` one for each internal state, in their order. Plain
        operators only: one formula runs on floats, arrays, complex numbers and CasADi symbols. Below depth 0 it is not
        asked, or below `pull_off_depth` where it is `adhesive`: see `contact_force`.
        """

    def pull_off_depth(self, theta: Sequence[Any]) -> Any:
        """Return depth [m], 0 or below, at which a tip that leaves comes off; a tip that comes touches at depth 0."""
        return 0.0

    def memory_rate(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any]) -> tuple[Any, ...]:
        """Return time derivative of each internal state [unit/s], at any depth; empty for a model without memory."""
        return ()

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """Return elasticity and viscosity as parameter values imply them, where the model can; else nothing."""
        return ()

    def validity(self, depth: float) -> str:
        """Return the assumption of this model that fails at a depth [m], as a sentence; empty where all hold."""
        return ""

    def curved_share(self, curvature: Floats, depth: Floats) -> Floats | None:
        """Return the force (n,) on a skin of curvatures (n, 2) [1/m] over that on a flat one, at depths (n,) > 0 [m].

        None of a model that does not know, or that states what skin there is. Over a surface that says its curvatures,
        a track's forces are divided by it, so that its estimates are those of the material.
        """
        return None

    def other_geometries(self, depth: float, theta: Sequence[float]) -> Mapping[str, tuple[float, ...]]:
        """Return parameter values of the same force at a depth [m] under each geometry that the statements admit."""
        return {}

    def delay_shift(self, theta: Sequence[float]) -> tuple[float, ...]:
        """Return the shift of each estimated parameter per second of delay of the force [unit/s]; 0 where unknown.

        A force that is late by tau reads F(d, d') = K d + B d' as if B were smaller by K tau.
        """
        return (0.0,) * len(self.parameters)


def contact_force(
    model: ContactModel, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any] = (), *, pulls: bool = True
) -> Any:
    """Return the force [N] at any depth [m]: that of the model in contact, 0 out of it (paper, eq. final_ext_contact2).

    With ``pulls = False`` the force is never negative, unless the model is `adhesive`: a material that does not stick
    cannot hold a tip back that leaves faster than the material recovers.
    """
    edge = select(rate, 0.0, 0.0, model.pull_off_depth(theta)) if model.adhesive else 0.0
    above = depth - edge if model.adhesive else depth
    # Both branches are evaluated: the guarded argument keeps a Jacobian at d = 0 finite.
    force = select(above, 0.0, model.force(select(above, 0.0, depth, 1.0), rate, theta, memory), 0.0)
    return force if pulls or model.adhesive else select(force, 0.0, force, 0.0)
