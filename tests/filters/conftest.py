"""What tests of filters share: contact models of every kind, and real recordings where they are at hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from palpate import ContactModel, Indenter, Parameter, Samples
from palpate_models import Power, Sphere
from palpate_models.dimensionality_reduction import DimensionalityReduction
from pydantic import Field

Recording = Callable[[str, int], tuple[Samples, np.ndarray]]


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


@pytest.fixture(scope="session")
def contact_models() -> dict[str, tuple[ContactModel, list[float]]]:
    """A contact model of every kind, with parameters."""
    tip = Sphere(radius=5e-3)
    return {
        "sphere": (DimensionalityReduction(indenter=tip), [1.1e5, 360.0]),
        "quartic": (DimensionalityReduction(indenter=Power(exponent=4, coefficient=1e7)), [1.1e5, 360.0]),
        "kelvin-voigt": (KelvinVoigt(), [800.0, 14.0]),
        "hunt-crossley": (HuntCrossley(), [14000.0, 200.0, 1.5]),
        # The synthetic samples know nothing of the branch: what counts is that its state is carried along.
        "relaxing": (Relaxing(indenter=tip), [1.1e5, 360.0]),
    }


@pytest.fixture(scope="session")
def recording(shared: Path) -> Recording:
    """Samples of a recording whose motion is so many samples late, and its table (columns as in data/README.md)."""
    return lambda name, lateness: _read(shared / "ur3e-bota-2024" / f"{name}.csv.gz", lateness)


def _read(path: Path, lateness: int) -> tuple[Samples, np.ndarray]:
    table = np.loadtxt(path, delimiter=",")
    motion = table[max(lateness, 0) : len(table) + min(lateness, 0)]
    force = table[max(-lateness, 0) : len(table) - max(lateness, 0), 4]
    n = len(motion)
    stamp = np.arange(n, dtype=np.int64) * 2_000_000
    interval = np.full(n, 0.002)
    interval[0] = 0.0
    touched = np.cumsum(force > 0.25) > 2
    position, velocity = motion[:, 0] / 1e3, -motion[:, 3] / 1e3
    return Samples(stamp, stamp / 1e9, interval, force, position, velocity, touched, touched.copy()), motion
