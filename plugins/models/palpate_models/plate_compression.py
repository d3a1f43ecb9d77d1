"""Compression of a whole specimen between plates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Self

from palpate import ContactModel, Depth, MaterialValue, Parameter
from pydantic import Field, model_validator

from palpate_models.parameters import ELASTICITY

_PAPER_FACTOR = 1.75  # c, of the paper's compression test
_PAPER_SHAPE = 2.32  # D/H, of the same
_SHAPE_TOLERANCE = 0.05  # a choice: relative difference of D/H up to which the paper's factor holds
_MAX_STRAIN = 0.05  # by finite elements: there the secant factor is 3 % above the paper's


class PlateCompression(ContactModel):
    """A cylinder of diameter D and height H pressed between two plates that hold its faces: P = c E (d/H) pi D^2/4.

    The factor c is 1 for faces that slide and grows with D/H for faces that stick. The paper takes c = 1.75 at
    D/H = 2.32; finite elements of an incompressible cylinder give 1.705 at zero strain, and as a secant 1.80 at 5 % and
    1.90 at 10 %: E is uncertain by that much. No viscosity is in this model.
    Assumes a homogeneous, isotropic, incompressible cylinder, small strain, plates that are rigid and parallel.
    Source: paper, eq. of the compression test.
    """

    parameters: ClassVar[tuple[Parameter, ...]] = (ELASTICITY,)

    diameter: Depth = Field(gt=0, description="diameter D of the specimen")
    height: Depth = Field(gt=0, description="height H of the specimen")
    factor: float | None = Field(
        default=None, ge=1, lt=10, description="c; left out: 1.75, which is for a diameter/height of 2.32"
    )

    @model_validator(mode="after")
    def _check_factor(self) -> Self:
        shape = self.diameter / self.height
        if self.factor is None and abs(shape / _PAPER_SHAPE - 1) > _SHAPE_TOLERANCE:
            raise ValueError(f"the factor 1.75 is for a diameter/height of 2.32; here it is {shape:.2f}: give factor")
        return self

    @property
    def stiffness(self) -> float:
        """c pi D^2/(4 H) [m], the stiffness per Young's modulus."""
        factor = self.factor if self.factor is not None else _PAPER_FACTOR
        return factor * math.pi * self.diameter**2 / (4.0 * self.height)

    def force(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any] = ()) -> Any:
        """c E (d/H) pi D^2/4 [N]."""
        return self.stiffness * theta[0] * depth + 0.0 * rate

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """E itself."""
        return (MaterialValue("elasticity", theta[0], (1.0,)),)

    def validity(self, depth: float) -> str:
        """Return a warning beyond the strain at which the secant factor is 3 % above 1.75."""
        strain = depth / self.height
        if strain <= _MAX_STRAIN:
            return ""
        return f"the strain is {strain:.1%}; beyond {_MAX_STRAIN:.0%} the factor of the compression test grows"
