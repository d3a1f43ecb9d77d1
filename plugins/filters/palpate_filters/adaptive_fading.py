"""Adaptive fading: the covariance is inflated while innovations are large."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

from palpate import Settings, Speed
from pydantic import Field

Preset = Literal["palpate", "paper", "authors"]
PRESET = (
    '"palpate": ours; "paper": its rule as printed (signed test, no cap); "authors": constants of their code; '
    "keys that are given override the preset"
)


class AdaptiveFading(Settings):
    """Adaptive fading: P is multiplied by alpha, which rises while the innovation is large.

    alpha <- min(alpha_max, alpha + step_up) where |innovation| > theta, else max(1, alpha - step_down) (paper, section
    Dynamic Estimation). `theta` must exceed the standard deviation of the innovation, some 0.9 to 1 mm/s with the
    paper's noise, or alpha stays at its maximum.
    """

    theta: Speed = Field(default=1e-3, ge=0, description="innovation beyond which alpha rises")
    alpha_max: float = Field(default=1.02, ge=1, le=10, description="largest fading factor")
    step_up: float = Field(default=0.005, ge=0, le=10, description="rise of alpha in a step")
    step_down: float = Field(default=0.005, ge=0, le=10, description="fall of alpha in a step")
    signed: bool = Field(default=False, description="compare the innovation with its sign, as in the paper")
    covariance_cap: float = Field(
        default=1.0,
        gt=0,
        allow_inf_nan=False,
        description="fading raises no standard deviation beyond this multiple of its first value",
    )


class StrongFading(AdaptiveFading):
    """Adaptive fading for a state without derivatives of the parameters: further, and at once.

    See `AdaptiveFading`; only the defaults differ.
    """

    theta: Speed = Field(default=1.5e-3, ge=0, description="innovation beyond which alpha rises")
    alpha_max: float = Field(default=1.05, ge=1, le=10, description="largest fading factor")
    step_up: float = Field(default=0.05, ge=0, le=10, description="rise of alpha in a step")
    step_down: float = Field(default=0.05, ge=0, le=10, description="fall of alpha in a step")


_UNCAPPED = 1e9  # first standard deviations, a choice: so high that no covariance reaches it
# The constants of the code by the paper's authors.
_AUTHORS = {
    "fading": {
        "theta": 1.9e-3,
        "alpha_max": 1.003,
        "step_up": 1e-4,
        "step_down": 5e-5,
        "signed": True,
        "covariance_cap": _UNCAPPED,
    },
    "derivative_std": math.sqrt(0.1),  # P0 of the derivatives is 0.1 where that of the parameters is 1
}
_PRESETS: dict[str, dict[str, Any]] = {
    "paper": {"fading": {"signed": True, "covariance_cap": _UNCAPPED}},
    "authors": _AUTHORS,
}


def preset_below(data: Any, **more: Mapping[str, Any]) -> Any:
    """Return a filter's table, completed from its preset; `more` adds to presets by their name."""
    if not isinstance(data, dict) or data.get("preset") not in _PRESETS:
        return data
    name = data["preset"]
    preset = {**_PRESETS[name], **more.get(name, {})}
    # Stated keys override the preset one by one, also within the table of fading.
    fading = data.get("fading", {})
    if isinstance(fading, Settings):
        fading = {key: getattr(fading, key) for key in fading.model_fields_set}
    if isinstance(fading, dict):
        fading = {**preset["fading"], **fading}
    return {**preset, **data, "fading": fading}
