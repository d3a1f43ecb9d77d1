"""Patches of surface around points, as cubics: normal and curvatures, with what the scatter leaves open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Floats

_UNKNOWNS = 10
_OTHERS = np.array([[2, 1], [2, 0], [1, 0]])  # of three in rising order, without each, the larger first
_HIGHER = 2.0 / 3.0  # of k^3 r^2, r the root mean square distance: what a curvature k loses to terms of fourth order


@dataclass(frozen=True)
class SurfacePatch:
    """z = f + d x + e y + (a x^2 + 2 b x y + c y^2)/2 + terms of third order, in the tangent plane of a point."""

    position: Floats  # (3,) [m] of it, across from the point along `outwards`
    scatter: float  # [m] standard uncertainty of it along the normal
    normal: Floats  # (3,)
    normal_covariance: Floats  # (3, 3)
    shape: Floats  # (3, 3) [1/m] shape operator S, positive where convex: dn = S dx
    curvature: Floats  # (2,) [1/m] its eigenvalues in the tangent plane, the larger first
    curvature_std: Floats  # (2,)


def fit_patch(point: Floats, outwards: Floats, neighbours: Floats, heights: Floats | None = None) -> SurfacePatch:
    """The patch around one point (3,), see `fit_patches`; `heights` is (k, k)."""
    return fit_patches(point[None], outwards[None], neighbours[None], heights)[0]


def fit_patches(
    points: Floats, outwards: Floats, neighbours: Floats, heights: Floats | None = None
) -> list[SurfacePatch]:
    """The patches around points (n, 3), each by least squares over k > 10 neighbours (n, k, 3) [m].

    A patch's z axis looks outwards, along unit vectors (n, 3). Curvatures are eigenvalues of g^-1 h with the first and
    second fundamental forms g and h at x = y = 0. Terms of third order keep the slope right where the curvature
    changes; those of fourth order are taken for those of a sphere, which put a curvature k off by 2/3 k^3 r^2.
    `heights` (k, k) [m^2] is the covariance of the neighbours' z, besides their scatter about the cubic. Source: do
    Carmo 1976, section 3.3.
    """
    frame = tangent_frames(outwards)
    x, y, z = np.moveaxis((neighbours - points[:, None]) @ frame.transpose(0, 2, 1), 2, 0)
    scale = np.sqrt(np.mean(x * x + y * y, axis=1))
    u, v = x / scale[:, None], y / scale[:, None]
    terms = [np.ones_like(u), u, v, u * u / 2, u * v, v * v / 2, u**3, u * u * v, u * v * v, v**3]
    design = np.stack(terms, axis=2)
    solver = np.linalg.pinv(design)
    values = (solver @ z[:, :, None])[:, :, 0]
    residual = z - (design @ values[:, :, None])[:, :, 0]
    variance = np.sum(residual**2, axis=1) / (z.shape[1] - _UNKNOWNS)
    units = scale[:, None] ** np.repeat([0.0, 1.0, 2.0, 3.0], [1, 2, 3, 4])
    values, solver = values / units, solver / units[:, :, None]
    covariance = variance[:, None, None] * (solver @ solver.transpose(0, 2, 1))
    if heights is not None:
        covariance += solver @ heights @ solver.transpose(0, 2, 1)
        variance = variance + covariance[:, 0, 0]
    slope, (a, b, c) = values[:, 1:3], values[:, 3:6].T
    length = np.sqrt(1.0 + np.sum(slope**2, axis=1))
    normal = _turned(frame, np.column_stack([-slope, np.ones(len(slope))])) / length[:, None]
    # Columns of `axes` are the tangents along x and y; a vector's components along them are metric^-1 axes^T.
    level = np.broadcast_to(np.eye(2), (len(slope), 2, 2))
    axes = frame.transpose(0, 2, 1) @ np.concatenate([level, slope[:, None]], axis=1)
    tilt = -axes @ np.linalg.inv(level + slope[:, :, None] * slope[:, None]) / length[:, None, None]
    hessian = np.stack([a, b, b, c], axis=1).reshape(-1, 2, 2)
    shape = -tilt @ hessian @ tilt.transpose(0, 2, 1) * length[:, None, None]
    curvature, directions = _principal(shape, normal)
    beyond = _HIGHER * np.abs(curvature).max(axis=1) ** 3 * scale**2
    spread = _curvature_std(directions @ frame.transpose(0, 2, 1), covariance[:, 3:6, 3:6])
    columns = (
        points + values[:, :1] * outwards,
        np.sqrt(variance) / length,
        normal,
        tilt @ covariance[:, 1:3, 1:3] @ tilt.transpose(0, 2, 1),
        shape,
        curvature,
        np.hypot(spread, beyond[:, None]),
    )
    return [SurfacePatch(*row) for row in zip(*columns, strict=True)]


def _turned(frame: Floats, vectors: Floats) -> Floats:
    """Vectors (n, 3) of frames (n, 3, 3) in the axes in which these are given."""
    return np.asarray((frame.transpose(0, 2, 1) @ vectors[:, :, None])[:, :, 0])


def _principal(shape: Floats, normal: Floats) -> tuple[Floats, Floats]:
    """Principal curvatures (n, 2), the larger first, and the direction of each as rows (n, 2, 3)."""
    curvature, columns = np.linalg.eigh((shape + shape.transpose(0, 2, 1)) / 2)
    directions = columns.transpose(0, 2, 1)
    # The eigenvalue of the normal itself is 0, and is left out by its direction.
    own = np.abs(directions @ normal[:, :, None])[:, :, 0].argmax(axis=1)
    rows, across = np.arange(len(own))[:, None], _OTHERS[own]
    return curvature[rows, across], directions[rows, across]


def _curvature_std(directions: Floats, covariance: Floats) -> Floats:
    """Of curvatures along directions (n, 2, 3) near the tangent plane, from covariances (n, 3, 3) of (a, b, c)."""
    level = directions[:, :, :2]
    x, y = np.moveaxis(level / np.maximum(np.linalg.norm(level, axis=2), 1e-12)[:, :, None], 2, 0)
    along = np.stack([x * x, 2 * x * y, y * y], axis=2)
    variance = np.einsum("nij,njk,nik->ni", along, covariance, along)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def tangent_frame(normal: Floats) -> Floats:
    """(3, 3) rows: two axes across a unit vector (3,), and the vector itself."""
    return np.asarray(tangent_frames(normal[None])[0])


def tangent_frames(normals: Floats) -> Floats:
    """(n, 3, 3) rows of each: two axes across a unit vector (3,), and the vector itself."""
    other = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    x = other - np.sum(other * normals, axis=1)[:, None] * normals
    x /= np.linalg.norm(x, axis=1)[:, None]
    return np.stack([x, np.cross(normals, x), normals], axis=1)
