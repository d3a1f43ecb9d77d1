"""Layers on top of a simulated material, as a tip feels them at each depth."""

from __future__ import annotations

from typing import Any

import numpy as np
from palpate import Floats, Indenter, Length, Settings
from pydantic import Field

MAX_DEPTH = 0.03  # [m] of the table of depths (a choice); beyond it the last value holds
DEPTH_COUNT = 400  # of the table (a choice): steps from 0.2 um near the skin, where the factor changes most, to 0.15 mm
MIN_RADIUS = 1e-9  # [m], guards against a division by 0


class Layer(Settings):
    """A layer of another stiffness, as large as the specimen and bonded to what lies below it."""

    thickness: Length = Field(gt=0, description="its thickness")
    stiffness_ratio: float = Field(
        gt=0, allow_inf_nan=False, description="its stiffness, relative to the material under all layers"
    )


def depth_share(ratio: Floats) -> Floats:
    """Return the share (n,) of a flat tip's compliance that comes from less than z deep, Gao's function at nu = 0.5.

    `ratio` (n,) is x = z/a, the depth over the tip's radius: I(x) = (2/pi) atan x - x/(pi (1 + x^2)).
    Source: Gao, Chiu and Lee 1992, eq. 22.
    """
    return np.asarray((2 / np.pi) * np.arctan(ratio) - ratio / (np.pi * (1 + ratio**2)))


def layered_factors(layers: tuple[Layer, ...], indenter: Indenter) -> tuple[Floats, Floats]:
    """Return depths (400,) [m], and factors: force of a layered material over that of its lowest one alone.

    A flat tip of radius a feels 1/E(a) = sum of [I(z_i+1/a) - I(z_i/a)]/E_i over the layers between z_i and z_i+1, the
    lowest without end (first-order perturbation of the half-space). A round tip that goes deeper by dd presses like a
    flat one of its present contact radius, so the factor is that of F(d) = 2 E*(a(d')) a(d') integrated from 0 to d.
    Exact for layers that are alike, and for very thick or thin ones; contact radius as on the half-space.
    Source: Gao, Chiu and Lee 1992; increments: Mossakovskii 1963.
    """
    depths = MAX_DEPTH * np.linspace(0.0, 1.0, DEPTH_COUNT + 1) ** 2
    middles = 0.5 * (depths[1:] + depths[:-1])
    radius = np.array([float(indenter.contact_radius(depth)) for depth in middles])
    # Increments a dd of the homogeneous force over 2 E*, by the midpoint rule.
    increments = radius * np.diff(depths)
    factors = np.cumsum(increments * flat_factor(layers, radius)) / np.cumsum(increments)
    return depths[1:], factors


def flat_factor(layers: tuple[Layer, ...], radius: Any) -> Floats:
    """Return the stiffness (n,) of a layered material over that of its lowest one, felt by flat tips of radii (n,) [m].

    The compliance is the sum over the layers of [I(z_i+1/a) - I(z_i/a)]/(E_i/E_lowest), with I of `depth_share`.
    """
    radius = np.maximum(np.asarray(radius, float), MIN_RADIUS)
    compliance = np.zeros_like(radius)
    share_above = np.zeros_like(radius)  # I at the top of the layer
    bottom = 0.0  # depth of the layer's lower side [m]
    for layer in layers:
        bottom += layer.thickness
        share = depth_share(bottom / radius)
        compliance += (share - share_above) / layer.stiffness_ratio
        share_above = share
    return np.asarray(1.0 / (compliance + 1.0 - share_above))
