"""Two layers: the share of the upper one against the exact solution, and what a press determines."""

import math

import numpy as np
import pytest
from palpate import ConfigurationError
from palpate_models import Cone, Sphere, TwoLayers
from palpate_models.two_layers import layer_share

LAYERED = TwoLayers(indenter=Sphere(radius=5e-3), skin_thickness=3e-3)


def surface_compliance(s, ratio):
    """Of a layer of a modulus over that of its base under a load cos(s r/h), over that of a half-space of the layer.

    Both incompressible, so that displacements are those of Stokes' equations: u = (A + B z) e^-z + (C + D z) e^(z - s)
    in the layer, (E + F z) e^-z below it, with depths in s; tractions and displacements agree between the two.
    """
    left, right = np.zeros((len(s), 6, 6)), np.zeros((len(s), 6))

    def columns(z, t):
        down, up = np.exp(-z), np.exp(z - t)
        zero = np.zeros_like(down)
        u = np.stack([down, z * down, up, z * up], axis=-1)
        slope = np.stack([-down, (1 - z) * down, up, (1 + z) * up], axis=-1)
        bend = np.stack([down, (z - 2) * down, up, (2 + z) * up], axis=-1)
        return u, slope, bend, np.stack([zero, 2 * down, zero, 2 * up], axis=-1)

    u, slope, bend, pressure = columns(np.zeros_like(s), s)
    left[:, 0, :4] = -(bend + u)  # no shear at the top
    left[:, 1, :4], right[:, 1] = ratio * (2 * slope - pressure), -1.0
    top = u
    u, slope, bend, pressure = columns(s, s)
    below = np.array([[1.0, 0.0], [-1.0, 1.0], [1.0, -2.0], [0.0, 2.0]])
    rows = (u, slope, ratio * (2 * slope - pressure), ratio * (bend + u))
    others = (below[0], below[1], 2 * below[1] - below[3], below[2] + below[0])
    for place, (row, other) in enumerate(zip(rows, others), 2):
        left[:, place, :4], left[:, place, 4:] = row, -other
    found = np.linalg.solve(left, right[:, :, None])[:, :4, 0]
    return (top * found).sum(axis=1) * 2 * ratio


def exact_factors(ratio, thicknesses):
    """x = sqrt(R d)/h and force over that on the lower material alone, for layers (n,) in contact radii.

    Fredholm's equation for the paraboloid (Dhaliwal and Rau 1970), phi + K phi = d - t^2, phi(1) = 0, by quadrature.
    """
    t, weight = np.polynomial.legendre.leggauss(40)
    t, weight = (t + 1) / 2, weight / 2
    s = (np.arange(900) + 0.5) * 40 / 900
    beyond = surface_compliance(s, ratio) - 1
    found = []
    for h in thicknesses:
        waves = np.cos(np.outer(np.append(t, 1.0), s / h))
        kernel = 2 / np.pi * (waves * (beyond * 40 / 900 / h)) @ waves[:-1].T * weight
        one, square = np.linalg.solve(np.eye(40) + kernel[:-1], np.column_stack([np.ones(40), t**2])).T
        depth = (1 - kernel[-1] @ square) / (1 - kernel[-1] @ one)
        found.append((math.sqrt(depth) / h, 2 * ratio * weight @ (depth * one - square) / (4 / 3 * depth**1.5)))
    return np.array(found).T


@pytest.mark.parametrize("ratio", [0.08, 0.2, 0.5, 2.0, 5.0, 12.5])
def test_the_share_is_that_of_the_exact_solution(ratio):
    x, exact = exact_factors(ratio, np.geomspace(0.085, 25.0, 9))
    assert x.max() > 10.0
    np.testing.assert_allclose(ratio ** layer_share(math.log(ratio), x), exact, rtol=LAYERED.law_error)


def test_layers_that_are_alike_are_one_half_space():
    for depth in (1e-5, 1e-3, 4e-3):
        hertz = 16 / 9 * 1e5 * math.sqrt(5e-3) * depth**1.5
        assert LAYERED.force(depth, 0.0, (1e5, 1e5, 0.0)) == pytest.approx(hertz, rel=1e-12)


def test_a_shallow_press_feels_the_layer_and_a_thin_layer_is_not_felt():
    theta = (3e5, 6e4, 0.0)
    shallow = LAYERED.force(1e-8, 0.0, theta) / LAYERED.force(1e-8, 0.0, (3e5, 3e5, 0.0))
    assert shallow == pytest.approx(1.0, abs=0.02)
    thin = TwoLayers(indenter=Sphere(radius=5e-3), skin_thickness=1e-4)
    assert thin.force(4e-3, 0.0, theta) / thin.force(4e-3, 0.0, (6e4, 6e4, 0.0)) == pytest.approx(1.0, abs=0.02)


def relative_std(model, theta, depths, noise=0.02):
    """Of each parameter, of presses to depths [m] by one tip each: Cramer and Rao's bound, at rest."""
    slopes = []
    for one, deepest in zip(model if isinstance(model, list) else [model], depths):
        depth = np.linspace(1e-5, deepest, 300)
        changed = [np.where(np.arange(len(theta)) == i, 1.0001, 1.0) * theta for i in range(len(theta))]
        slopes += [np.array([one.force(depth, 0.0, c) - one.force(depth, 0.0, theta) for c in changed]) / 1e-4 / noise]
    every = np.hstack(slopes)[[0, 1]]
    return np.sqrt(np.diag(np.linalg.inv(every @ every.T)))


def test_a_deep_press_or_two_tips_tell_the_moduli_apart_and_a_shallow_one_does_not():
    theta = np.array([1.5e5, 5e4, 0.0])
    (shallow,), (deep,) = ([relative_std(LAYERED, theta, [depth])] for depth in (2e-4, 4e-3))
    assert deep.max() < 0.03
    assert shallow[1] > 20 * deep[1]
    small, large = (TwoLayers(indenter=Sphere(radius=r), skin_thickness=3e-3) for r in (1e-3, 20e-3))
    both = relative_std([small, large], theta, [1e-3, 1e-3])
    assert both[1] < 0.5 * relative_std(small, theta, [1e-3])[1]


def test_tips_and_ranges_that_are_not_known_are_said():
    with pytest.raises(ConfigurationError, match="two layers are known under spheres, not under a Cone"):
        TwoLayers(indenter=Cone(angle=0.5), skin_thickness=3e-3)
    assert LAYERED.validity(1e-3) == ""
    thin = TwoLayers(indenter=Sphere(radius=5e-3), skin_thickness=1e-4)
    assert "of the layer's thickness; known to 13" in thin.validity(1e-3)
