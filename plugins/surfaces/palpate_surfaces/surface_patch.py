"""The patch of surface around a point, as a cubic: normal and curvatures, with what the scatter leaves open."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from palpate import Floats

_UNKNOWNS = 10
_ORDERS = np.repeat([0, 1, 2, 3], [1, 2, 3, 4])  # of them in x and y
_HIGHER = 2.0 / 3.0  # of k^3 r^2, r the root mean square distance: what a curvature k loses to terms of fourth order


@dataclass(frozen=True)
class SurfacePatch:
    """z = f + d x + e y + (a x^2 + 2 b x y + c y^2)/2 + terms of third order, in the tangent plane of a point.

    Of several points each field has a row for each.
    """

    position: Floats  # (3,) [m] of it, across from the point along `outwards`
    scatter: Floats  # () [m] standard uncertainty of it along the normal
    normal: Floats  # (3,)
    normal_covariance: Floats  # (3, 3)
    shape: Floats  # (3, 3) [1/m] shape operator S, positive where convex: dn = S dx
    curvature: Floats  # (2,) [1/m] its eigenvalues in the tangent plane, the larger first
    curvature_std: Floats  # (2,)

    def __getitem__(self, row: int) -> SurfacePatch:
        return SurfacePatch(**{field.name: getattr(self, field.name)[row] for field in fields(self)})


def fit_patch(point: Floats, outwards: Floats, neighbours: Floats, heights: Floats | None = None) -> SurfacePatch:
    """Return the patch around one point (3,); see `fit_patches`."""
    return fit_patches(point[None], outwards[None], neighbours[None], None if heights is None else heights[None])[0]


def fit_patches(points: Floats, outwards: Floats, neighbours: Floats, heights: Floats | None = None) -> SurfacePatch:
    """The patches around points (k, 3) by least squares over neighbours (k, n, 3) [m], n > 10; z axes look outwards.

    Curvatures are eigenvalues of g^-1 h with the first and second fundamental forms g and h at x = y = 0. Terms of
    third order keep the slope right where the curvature changes; those of fourth order are taken for those of a sphere,
    which put a curvature k off by 2/3 k^3 r^2. `heights` (k, n, n) [m^2] is the covariance of the neighbours' z,
    besides their scatter about the cubic. A patch is the same, bit for bit, whatever others are fitted with it. Source:
    do Carmo 1976, section 3.3.
    """
    frame = _tangent_frames(outwards)
    x, y, z = np.moveaxis((neighbours - points[:, None]) @ frame.transpose(0, 2, 1), -1, 0).copy()
    scale = np.sqrt(np.mean(x * x + y * y, axis=1))
    u, v = x / scale[:, None], y / scale[:, None]
    cubic = (np.ones_like(u), u, v, u * u / 2, u * v, v * v / 2, u**3, u * u * v, u * v * v, v**3)
    design = np.stack(cubic, axis=-1)
    inverse_design = np.linalg.pinv(design)
    values = (inverse_design @ z[..., None])[..., 0]
    residual = z - (design @ values[..., None])[..., 0]
    variance = (residual * residual).sum(axis=1) / (z.shape[1] - _UNKNOWNS)
    units = scale[:, None] ** _ORDERS
    solver = inverse_design / units[..., None]
    covariance = variance[:, None, None] * (solver @ solver.transpose(0, 2, 1))
    if heights is not None:
        covariance += solver @ heights @ solver.transpose(0, 2, 1)
        variance = variance + covariance[:, 0, 0]
    f, d, e, a, b, c, *_ = (values / units).T
    slope = np.stack([d, e], axis=-1)
    length = np.sqrt(1.0 + d * d + e * e)
    # Columns of `axes` are the tangents along x and y; a vector's components along them are metric^-1 axes^T.
    inverse = np.linalg.inv(np.eye(2) + slope[:, :, None] * slope[:, None])
    tangents = np.concatenate([np.broadcast_to(np.eye(2), (len(points), 2, 2)), slope[:, None]], axis=1)
    axes = frame.transpose(0, 2, 1) @ tangents
    hessian = np.stack([a, b, b, c], axis=-1).reshape(-1, 2, 2)
    shape = -(axes @ inverse @ hessian @ inverse @ axes.transpose(0, 2, 1)) / length[:, None, None]
    upwards = np.stack([-d, -e, np.ones_like(d)], axis=-1)
    normal = (upwards[:, None] @ frame)[:, 0] / length[:, None]
    curvature, directions = _principal(shape, normal)
    tangential = (frame @ directions)[:, :2]
    beyond = _HIGHER * np.abs(curvature).max(axis=1) ** 3 * scale**2
    tilt = -(axes @ inverse) / length[:, None, None]
    return SurfacePatch(
        position=points + f[:, None] * outwards,
        scatter=np.sqrt(variance) / length,
        normal=normal,
        normal_covariance=tilt @ covariance[:, 1:3, 1:3] @ tilt.transpose(0, 2, 1),
        shape=shape,
        curvature=curvature,
        curvature_std=np.hypot(_curvature_std(tangential, covariance[:, 3:6, 3:6]), beyond[:, None]),
    )


def _principal(shape: Floats, normal: Floats) -> tuple[Floats, Floats]:
    """Principal curvatures (k, 2), the larger first, and their directions (k, 3, 2), of shape operators (k, 3, 3)."""
    curvature, directions = np.linalg.eigh((shape + shape.transpose(0, 2, 1)) / 2)
    # The eigenvalue of the normal itself is 0, and is left out by its direction.
    own = np.argmax(np.abs(normal[:, None] @ directions)[:, 0], axis=1)
    curvature[np.arange(len(shape)), own] = -np.inf
    across = np.argsort(-curvature, axis=1)[:, :2]
    return np.take_along_axis(curvature, across, axis=1), np.take_along_axis(directions, across[:, None], axis=2)


def _curvature_std(directions: Floats, covariance: Floats) -> Floats:
    """Of the curvatures along directions (k, 2, j) of tangent planes (k, j), from the covariances of (a, b, c)."""
    x, y = np.moveaxis(directions / np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-12), 1, 0)
    along = np.stack([x * x, 2 * x * y, y * y], axis=-1)  # (k, j, 3)
    return np.asarray(np.sqrt(np.maximum(((along @ covariance) * along).sum(axis=-1), 0.0)), np.float64)


def _tangent_frames(normals: Floats) -> Floats:
    """(k, 3, 3) rows: two axes across unit vectors (k, 3), and the vectors themselves."""
    other = np.where(np.abs(normals[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    x = other - (other * normals).sum(axis=1, keepdims=True) * normals
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    return np.asarray(np.stack([x, np.cross(normals, x), normals], axis=1), np.float64)


def tangent_frame(normal: Floats) -> Floats:
    """(3, 3) rows: two axes across a unit vector (3,), and the vector itself."""
    return np.asarray(_tangent_frames(normal[None])[0])
