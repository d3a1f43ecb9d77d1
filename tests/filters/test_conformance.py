"""Every estimator on every kind of contact model keeps the promises of `palpate.testing`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import pytest
from palpate import ContactModel, Estimator, Indenter, Parameter
from palpate.testing import check_estimator
from palpate_filters import palpate_estimators
from palpate_models.dimensionality_reduction import DimensionalityReduction
from palpate_models.indenters import Power, Sphere
from pydantic import Field


class KelvinVoigt(ContactModel):
    """F = K d + B d'."""

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("stiffness", "K", "N/m", "", role="elastic"),
        Parameter("damping", "B", "N*s/m", "", role="viscous"),
    )

    def force(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any] = ()) -> Any:
        return theta[0] * depth + theta[1] * rate


class HuntCrossley(ContactModel):
    """F = (K + B d') d^n."""

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("stiffness", "K", "N/m^n", "", role="elastic"),
        Parameter("damping", "B", "N*s/m^(n+1)", "", role="viscous"),
        Parameter("exponent", "n", "1", "", lower=1.0, upper=2.0),
    )

    def force(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any] = ()) -> Any:
        return (theta[0] + theta[1] * rate) * depth ** theta[2]


class Relaxing(ContactModel):
    """Hertz, and a Maxwell branch whose force is the internal state."""

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("elasticity", "E", "Pa", "", role="elastic"),
        Parameter("viscosity", "eta", "Pa*s", "", role="viscous"),
    )
    memory: ClassVar[tuple[str, ...]] = ("branch",)
    indenter: Indenter = Field(description="the tip")

    def force(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any] = ()) -> Any:
        elastic = 8.0 / 3.0 * theta[0] * self.indenter.profile_area(depth)
        branch = memory[0] if len(memory) else 0.0
        return elastic + 8.0 * theta[1] * self.indenter.contact_radius(depth) * rate + branch

    def memory_rate(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any]) -> tuple[Any, ...]:
        return (100.0 * rate - memory[0] / 0.2,)


TIP = Sphere(radius=5e-3)
MODELS: dict[str, tuple[ContactModel, list[float]]] = {
    "sphere": (DimensionalityReduction(indenter=TIP), [1.1e5, 360.0]),
    "quartic": (DimensionalityReduction(indenter=Power(exponent=4, coefficient=1e7)), [1.1e5, 360.0]),
    "kelvin-voigt": (KelvinVoigt(), [800.0, 14.0]),
    "hunt-crossley": (HuntCrossley(), [14000.0, 200.0, 1.5]),
}


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("estimator", palpate_estimators())
def test_estimator_conforms(estimator: str, model: str) -> None:
    part: type[Estimator] = palpate_estimators()[estimator]
    check_estimator(part(), *MODELS[model])


@pytest.mark.parametrize("estimator", ["ekf", "afukf", "kinematic-ekf", "kinematic-smoother"])
def test_models_that_remember_are_estimated(estimator: str) -> None:
    part: type[Estimator] = palpate_estimators()[estimator]
    # The synthetic samples know nothing of the branch: what counts is that its state is carried along.
    check_estimator(part(), Relaxing(indenter=TIP), [1.1e5, 360.0])
