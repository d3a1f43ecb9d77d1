"""The keys of the `casadi-fit` estimator."""

from __future__ import annotations

from typing import ClassVar, Literal

from palpate import Estimator, Force, Time
from pydantic import Field

Extra = Literal["bias", "slope", "tip_mass", "delay"]


class FitSettings(Estimator):
    """The settings of a fit: its unknowns, samples and start, and what it reports."""

    online: ClassVar[bool] = False
    motion: ClassVar[Literal["position", "velocity", "both"]] = "position"
    reusable: ClassVar[bool] = True

    segment: str = Field(
        default="active",
        description='samples to fit, joined by commas: "active" (contact and measuring), "all", "contact", "load", '
        '"unload", "hold" (depth or force steady), "cycle" (load and unload with air before and after), "0.5 s..2 s", '
        '"depth 0 mm..2 mm" (below first touch), "cycles 1..3"',
    )
    contact_point: Literal["free", "threshold", "deviation-from-baseline", "gradient"] = Field(
        default="free",
        description="where the surface is: an unknown of the fit, or determined by a method on the force alone",
    )
    threshold: Force | None = Field(
        default=None, gt=0, description='force of the "threshold" method; left out: 5 sigma of the air before touch'
    )
    unknowns: tuple[Extra, ...] | None = Field(
        default=None,
        description='what to fit besides the model and the surface: "bias", "slope" [N/s], "tip_mass", "delay" (of the '
        "force); left out: the bias, where a tenth of the samples is in air, or a record begins in contact without a "
        "stated zero of the force",
    )
    fixed: dict[str, float | str] = Field(
        default={}, description='values that are known, by name: { viscosity = 0.0, surface = "0.3 mm" }'
    )
    start_at: dict[str, float | str] = Field(
        default={}, description="where to start, by name; left out: a search over surface and exponents"
    )
    bounds: dict[str, tuple[float | str, float | str]] = Field(
        default={}, description='bounds by name: { elasticity = ["1 kPa", "1 MPa"] }'
    )
    force_uncertainty: Force | None = Field(
        default=None, gt=0, description="F_unc: the measured force at the surface is within it; left out: no constraint"
    )
    weights: Literal["uniform", "depth"] = Field(
        default="uniform", description='"uniform": each sample counts the same; "depth": each stretch of depth does'
    )
    loss: Literal["linear", "huber", "soft-l1"] = Field(default="linear", description="how much a residual counts")
    loss_scale: Force = Field(default=0.1, gt=0, description="residual beyond which a robust loss counts less")
    solver: Literal["auto", "lm", "trf"] = Field(
        default="auto",
        description='"lm": normal equations, for models without memory; "trf": triangular factors, for any; '
        '"auto": "lm" where it can be',
    )
    smoothing: Time | None = Field(
        default=None,
        ge=0,
        description="window of the local cubic for rate and acceleration; left out: as short as noise allows",
    )
    confidence: float = Field(default=0.95, gt=0.5, lt=1, description="of the intervals")
    profile: bool = Field(default=True, description="profile-likelihood intervals")
    bootstrap: int = Field(default=0, ge=0, le=10_000, description="refits of a block bootstrap; 0: none")
    seed: int = Field(default=0, ge=0, description="seed of the bootstrap")
    systematic: dict[str, float | str] = Field(
        default={},
        description="standard uncertainties of what is assumed exact, by key of the model, name of what is fixed, "
        '"tip_mass", "bias", "force_scale" or "position_scale": { radius = "20 um", poisson = 0.01, surface = "5 um" }',
    )

    @property
    def robust(self) -> bool:
        """See `palpate.Estimator`."""
        return self.loss != "linear"
