"""Layers on top of a simulated material, as a tip feels them at each depth."""

from __future__ import annotations

from typing import Any

import numpy as np
from palpate import Floats, Indenter, Length, Settings
from pydantic import Field

_DEEPEST = 0.03  # [m] of the table of depths; deeper, the last value holds
_NODES = 400


class Layer(Settings):
    """A layer of another stiffness, as large as the specimen and bonded to what lies below it."""

    thickness: Length = Field(gt=0, description="its thickness")
    stiffness_ratio: float = Field(
        gt=0, allow_inf_nan=False, description="its stiffness, relative to the material under all layers"
    )


def depth_share(ratio: Floats) -> Floats:
    """Share of a flat tip's compliance that comes from less than z deep, for z/a (n,): Gao's function at nu = 0.5.

    I(x) = (2/pi) atan x - x/(pi (1 + x^2)). Source: Gao, Chiu and Lee 1992, eq. 22.
    """
    return np.asarray((2 / np.pi) * np.arctan(ratio) - ratio / (np.pi * (1 + ratio**2)))


def layered_factors(layers: tuple[Layer, ...], indenter: Indenter) -> tuple[Floats, Floats]:
    """Depths [m], and at them the force of a layered material over that of its lowest material alone.

    A flat tip of radius a feels 1/E(a) = sum of [I(z_i+1/a) - I(z_i/a)]/E_i over the layers between z_i and z_i+1, the
    lowest without end (first-order perturbation of the half-space). A round tip that goes deeper by dd presses like a
    flat one of its present contact radius, so the factor is that of F(d) = 2 E*(a(d')) a(d') integrated from 0 to d.
    Exact for layers that are alike, and for very thick or thin ones; contact radius as on the half-space.
    Source: Gao, Chiu and Lee 1992; increments: Mossakovskii 1963.
    """
    nodes = _DEEPEST * np.linspace(0.0, 1.0, _NODES + 1) ** 2
    middle = 0.5 * (nodes[1:] + nodes[:-1])
    radius = np.array([float(indenter.contact_radius(value)) for value in middle])
    push = radius * np.diff(nodes)
    factors = np.cumsum(push * flat_factor(layers, radius)) / np.cumsum(push)
    return nodes[1:], factors


def flat_factor(layers: tuple[Layer, ...], radius: Any) -> Floats:
    """Stiffness of a layered material over that of its lowest one, as flat tips of radii (n,) [m] feel it."""
    radius = np.maximum(np.asarray(radius, float), 1e-9)
    compliance, share, bottom = np.zeros_like(radius), np.zeros_like(radius), 0.0
    for layer in layers:
        bottom += layer.thickness
        reached = depth_share(bottom / radius)
        compliance += (reached - share) / layer.stiffness_ratio
        share = reached
    return np.asarray(1.0 / (compliance + 1.0 - share))
