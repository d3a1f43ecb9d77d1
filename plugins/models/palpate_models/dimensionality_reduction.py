"""The method of dimensionality reduction, elastic and viscous: the paper's contact model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal, Self

from palpate import ContactModel, Floats, Indenter, MaterialValue, Parameter
from pydantic import BeforeValidator, Field, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema

from palpate_models.other_layers import other_layers
from palpate_models.parameters import ELASTICITY, VISCOSITY
from palpate_models.relaxation_spectrum import RelaxationSpectrum
from palpate_models.skin import ContactGeometry, Skin, curved_share
from palpate_models.thickness import HALF_SPACE, Thickness
from palpate_models.ting_unloading import ting_force


class _NoneInTheSchema:
    """Says in the JSON schema that "none" and "half-space" are allowed."""

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [{"enum": ["none", HALF_SPACE]}, handler(schema)]}


OptionalThickness = Annotated[
    Thickness | Literal["half-space"] | None,
    BeforeValidator(lambda value: None if value == "none" else value),
    _NoneInTheSchema(),
]


SKIN = (
    'the skin where it is not level and flat, such as { inclination = "20 deg", skin_radius = "50 mm" }; left out: '
    "assumed to be both"
)


class DimensionalityReduction(ContactModel):
    """A soft half-space as a row of springs and dampers, pressed by any axisymmetric tip.

    F = 2 E/(1 - nu^2) A(d) + 4 eta/(1 - nu) a(d) d', with the tip's contact radius a(d) and profile area A(d).
    For a sphere this is (4/3) E/(1 - nu^2) sqrt(R) d^1.5 + 4 eta/(1 - nu) sqrt(R d) d'. With `thickness`, A becomes
    A(d) c(d) and a becomes its derivative (see the `thickness` key: dimitriadis, garcia, finite-cylinder); `skin`
    states an inclination and curvature. Assumes a homogeneous, isotropic half-space, flat but for these, small strain
    (a/R well below 1, depth below some 10 % of the thickness), no friction on a level skin and no adhesion; material of
    Kelvin-Voigt type.
    Source: paper, eqs. kv_el and TotalForce; Popov and Hess 2015.
    """

    parameters: ClassVar[tuple[Parameter, ...]] = (ELASTICITY, VISCOSITY)

    indenter: Indenter = Field(description="the tip")
    poisson: float = Field(default=0.5, ge=0, le=0.5, description="Poisson's ratio nu; 0.5 for incompressible material")
    thickness: OptionalThickness = Field(
        default=None,
        description='correction for a layer, such as { law = "dimitriadis", height = "22 mm", bonded = false }; '
        'laws: dimitriadis, garcia, finite-cylinder, table; "half-space": the specimen is thick, nothing is corrected; '
        'left out or "none": the same, but not declared',
    )
    skin: Skin | None = Field(default=None, description=SKIN)

    @model_validator(mode="after")
    def _known_correction(self) -> Self:
        ContactGeometry.of(self).check()
        return self

    def force(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any] = ()) -> Any:
        """2 E/(1 - nu^2) A(d) + 4 eta/(1 - nu) a(d) d' [N]."""
        elasticity, viscosity = theta
        area, radius = ContactGeometry.of(self).contact(depth)
        elastic = 2.0 / (1.0 - self.poisson**2) * elasticity * area
        return elastic + 4.0 / (1.0 - self.poisson) * viscosity * radius * rate

    def loading_cycle_force(self, time: Floats, depth: Floats, theta: Sequence[float], reversal: float) -> Floats:
        """Force (n,) [N] over one loading and one unloading, see `ting_force`."""
        return ting_force(self, RelaxationSpectrum(theta[0], theta[1], ()), time, depth, reversal)

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """The parameters themselves."""
        return (MaterialValue("elasticity", theta[0], (1.0, 0.0)), MaterialValue("viscosity", theta[1], (0.0, 1.0)))

    def validity(self, depth: float) -> str:
        """What does not hold of tip, skin or thickness correction at a depth [m]."""
        return ContactGeometry.of(self).validity(depth)

    def curved_share(self, curvature: Floats, depth: Floats) -> Floats | None:
        """See `palpate_models.skin.curved_share`."""
        return curved_share(self, curvature, depth)

    def other_geometries(self, depth: float, theta: Sequence[float]) -> dict[str, tuple[float, ...]]:
        """Layers that what is stated of the thickness admits as well, see `other_layers`."""
        return other_layers(self.parameters, theta, self.indenter, self.thickness, depth)

    def delay_shift(self, theta: Sequence[float]) -> tuple[float, ...]:
        """A late force lowers viscosity by the shear modulus G = E/(2 (1 + nu)) per second, for every tip."""
        return 0.0, -theta[0] / (2.0 * (1.0 + self.poisson))
