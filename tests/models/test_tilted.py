"""The tilted flat tip against a contact that is solved by boundary elements, and against the flat one."""

from __future__ import annotations

import numpy as np
import pytest
from palpate_models import DimensionalityReduction, Flat, TiltedFlat

R, TILT = 5e-3, 0.04
TIP = TiltedFlat(radius=R, tilt=TILT)


def settling(x, y, half):
    """pi E* times the displacement at x, y by a unit pressure on a square of half-width `half` (Love 1929)."""

    def part(p, q):
        return p * np.arcsinh(q / np.abs(p))

    right, left, up, down = x + half, x - half, y + half, y - half
    return (
        part(right, up) - part(right, down) + part(up, right) - part(up, left)
        - part(left, up) + part(left, down) - part(down, right) + part(down, left)
    )  # fmt: skip


def pressed(share, cells):
    """Force over E* R^2 t of a tilted disc at a depth of `share` times R t, by squares of constant pressure >= 0."""
    width = 2.0 / cells
    line = (np.arange(cells) + 0.5) * width - 1.0
    x, y = (grid.ravel() for grid in np.meshgrid(line, line))
    near = (x**2 + y**2 < 1) & (x > 1 - share - 2 * width)
    x, y = x[near], y[near]
    compliance = settling(x[:, None] - x + 1e-12, y[:, None] - y + 1e-12, width / 2) / np.pi
    into = share - 1 + x
    touching = into > 0
    for _ in range(60):
        pressure = np.zeros(len(x))
        pressure[touching] = np.linalg.solve(compliance[np.ix_(touching, touching)], into[touching])
        pulled, overlapping = pressure < 0, ~touching & (compliance @ pressure < into - 1e-12)
        if not pulled.any() and not overlapping.any():
            break
        touching = touching & ~pulled | overlapping
    # All of a flat disc's force is 2; the squares along its edge are a little off it.
    whole = 2.0 / (np.linalg.solve(compliance, np.ones(len(x))).sum() * width**2) if share > 2 - 2 * width else 1.0
    return float(pressure.sum() * width**2) * whole


@pytest.mark.parametrize(
    ("share", "cells", "within"),
    [
        (0.4, 60, 0.03),
        pytest.param(1.0, 40, 0.02, marks=pytest.mark.slow),
        pytest.param(1.5, 36, 0.02, marks=pytest.mark.slow),
        pytest.param(2.0, 30, 0.02, marks=pytest.mark.slow),
        (4.0, 24, 1e-6),
    ],
)
def test_boundary_elements_give_the_same_force(share, cells, within):
    own = 2 * TIP.profile_area(share * R * TILT) / (R**2 * TILT)
    assert own == pytest.approx(pressed(share, cells), rel=within)


def test_in_full_contact_it_is_the_flat_tip_at_the_depth_of_its_middle():
    depth = np.linspace(TIP.full_depth, 4e-3, 50)
    flat = DimensionalityReduction(indenter=Flat(radius=R))
    tilted = DimensionalityReduction(indenter=TIP)
    theta = [112.5e3, 362.0]
    expected = flat.force(depth - R * TILT, 1e-3, theta)
    np.testing.assert_allclose(tilted.force(depth, 1e-3, theta), expected, rtol=1e-12)


def test_area_is_the_integral_of_the_contact_radius():
    depth = np.linspace(0.0, 2 * TIP.full_depth, 20001)
    radius = TIP.contact_radius(depth)
    area = np.concatenate([[0.0], np.cumsum((radius[1:] + radius[:-1]) / 2 * np.diff(depth))])
    np.testing.assert_allclose(TIP.profile_area(depth), area, rtol=1e-5, atol=1e-13)
    assert (np.diff(radius) >= -1e-15).all()
    assert radius[-1] == pytest.approx(R, rel=1e-12)
