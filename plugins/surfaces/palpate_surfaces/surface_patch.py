"""The patch of surface around a point, as a cubic: normal and curvatures, with their uncertainty by the scatter."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from palpate import Floats

_COEFFICIENTS = 10  # of a cubic in x and y
_ORDERS = np.repeat([0, 1, 2, 3], [1, 2, 3, 4])  # of the coefficients' terms in x and y
_FOURTH_ORDER_SHARE = 2.0 / 3.0  # of k^3 r^2, by which a sphere's terms of fourth order put its curvature k off
_OFF_AXIS = 0.9  # cosine to the x axis below which x is far enough from a normal to make a frame: a choice
_MIN_LENGTH = 1e-12  # keeps a division by a length finite


@dataclass(frozen=True)
class SurfacePatch:
    """z = f + d x + e y + (a x^2 + 2 b x y + c y^2)/2 + terms of third order, in the tangent plane of a point.

    Of several points each field has a row for each.
    """

    position: Floats  # (3,) [m] of the surface, from the point along `outwards`
    scatter: Floats  # () [m] standard uncertainty of the position along the normal
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
    """Return the patches around points (k, 3) by least squares over neighbours (k, n, 3) [m], n > 10.

    z = f + d x + e y + (a x^2 + 2 b x y + c y^2)/2 + terms of third order; the z axes are the unit vectors `outwards`
    (k, 3). Curvatures are eigenvalues of g^-1 h with the first and second
    fundamental forms g and h at x = y = 0. Terms of third order keep the slope right where the curvature changes; those
    of fourth order are taken for those of a sphere, which put a curvature k off by 2/3 k^3 r^2, r the root mean square
    distance of the neighbours. `heights` (k, n, n) [m^2] is the covariance of the neighbours' z, besides their scatter
    about the cubic. A patch is the same, bit for bit, whatever others are fitted with it. Source: do Carmo 1976,
    section 3.3.
    """
    frame = _tangent_frames(outwards)
    coefficients, covariance, variance, scale = _fit_cubics(points, frame, neighbours, heights)
    f, d, e, a, b, c, *_ = coefficients.T
    slope = np.stack([d, e], axis=-1)
    normal_length = np.sqrt(1.0 + d * d + e * e)  # of (-d, -e, 1)

    # Columns of `tangents` are those along x and y in the work frame; a vector's components along them are
    # dual^T = g^-1 tangents^T, with the first fundamental form g = 1 + slope slope^T.
    inverse_metric = np.linalg.inv(np.eye(2) + slope[:, :, None] * slope[:, None])
    local_tangents = np.concatenate([np.broadcast_to(np.eye(2), (len(points), 2, 2)), slope[:, None]], axis=1)
    tangents = frame.transpose(0, 2, 1) @ local_tangents
    dual = tangents @ inverse_metric

    # Shape operator g^-1 h of the second fundamental form h = -Hessian/length, from both sides in the work frame.
    hessian = np.stack([a, b, b, c], axis=-1).reshape(-1, 2, 2)
    shape = -(dual @ hessian @ inverse_metric @ tangents.transpose(0, 2, 1))
    shape = shape / normal_length[:, None, None]
    upwards = np.stack([-d, -e, np.ones_like(d)], axis=-1)
    normal = (upwards[:, None] @ frame)[:, 0] / normal_length[:, None]
    curvature, directions = _principal_curvatures(shape, normal)

    # Uncertainties: the normal by the covariance of the slopes, curvatures by that of a, b, c and the fourth order.
    tilt = -dual / normal_length[:, None, None]
    fourth_order = _FOURTH_ORDER_SHARE * np.abs(curvature).max(axis=1) ** 3 * scale**2
    fit_std = _curvature_std((frame @ directions)[:, :2], covariance[:, 3:6, 3:6])
    return SurfacePatch(
        position=points + f[:, None] * outwards,
        scatter=np.sqrt(variance) / normal_length,
        normal=normal,
        normal_covariance=tilt @ covariance[:, 1:3, 1:3] @ tilt.transpose(0, 2, 1),
        shape=shape,
        curvature=curvature,
        curvature_std=np.hypot(fit_std, fourth_order[:, None]),
    )


def _fit_cubics(
    points: Floats, frame: Floats, neighbours: Floats, heights: Floats | None
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return coefficients (k, 10) of the cubics, their covariances (k, 10, 10), variances (k,) [m^2] and r (k,) [m].

    The cubics are z over x and y in frames (k, 3, 3) at points (k, 3); the variances are those of z at the points, r is
    the root mean square distance of the neighbours (k, n, 3). See `fit_patches`.
    """
    x, y, z = np.moveaxis((neighbours - points[:, None]) @ frame.transpose(0, 2, 1), -1, 0).copy()
    # In units of r, so that all columns are of one size.
    scale = np.sqrt(np.mean(x * x + y * y, axis=1))
    u, v = x / scale[:, None], y / scale[:, None]
    terms = (np.ones_like(u), u, v, u * u / 2, u * v, v * v / 2, u**3, u * u * v, u * v * v, v**3)
    design = np.stack(terms, axis=-1)
    inverse_design = np.linalg.pinv(design)
    scaled_coefficients = (inverse_design @ z[..., None])[..., 0]
    residual = z - (design @ scaled_coefficients[..., None])[..., 0]
    variance = (residual * residual).sum(axis=1) / (z.shape[1] - _COEFFICIENTS)
    units = scale[:, None] ** _ORDERS
    solver = inverse_design / units[..., None]  # coefficients = solver z
    covariance = variance[:, None, None] * (solver @ solver.transpose(0, 2, 1))
    if heights is not None:
        covariance += solver @ heights @ solver.transpose(0, 2, 1)
        variance = variance + covariance[:, 0, 0]
    return scaled_coefficients / units, covariance, variance, scale


def _principal_curvatures(shape: Floats, normal: Floats) -> tuple[Floats, Floats]:
    """Return principal curvatures (k, 2), the larger first, and their directions (k, 3, 2).

    They are eigenvalues and eigenvectors of the shape operators (k, 3, 3), except those of the normals (k, 3).
    """
    curvature, directions = np.linalg.eigh((shape + shape.transpose(0, 2, 1)) / 2)
    # The eigenvalue of the normal itself is 0; it is found by its direction, and sorted last.
    normal_column = np.argmax(np.abs(normal[:, None] @ directions)[:, 0], axis=1)
    curvature[np.arange(len(shape)), normal_column] = -np.inf
    columns = np.argsort(-curvature, axis=1)[:, :2]
    return np.take_along_axis(curvature, columns, axis=1), np.take_along_axis(directions, columns[:, None], axis=2)


def _curvature_std(directions: Floats, covariance: Floats) -> Floats:
    """Return the standard deviations (k, j) of curvatures along directions (k, 2, j) of the tangent planes.

    Along (x, y) the curvature is a x^2 + 2 b x y + c y^2; `covariance` (k, 3, 3) is that of (a, b, c).
    """
    lengths = np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), _MIN_LENGTH)
    x, y = np.moveaxis(directions / lengths, 1, 0)
    gradient = np.stack([x * x, 2 * x * y, y * y], axis=-1)  # (k, j, 3)
    variance = ((gradient @ covariance) * gradient).sum(axis=-1)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)), np.float64)


def _tangent_frames(normals: Floats) -> Floats:
    """Return frames (k, 3, 3), whose rows are two axes across unit vectors (k, 3), and the vectors themselves."""
    # The x or y axis, whichever is off the normal, without its part along the normal.
    reference = np.where(np.abs(normals[:, :1]) < _OFF_AXIS, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    x = reference - (reference * normals).sum(axis=1, keepdims=True) * normals
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    return np.asarray(np.stack([x, np.cross(normals, x), normals], axis=1), np.float64)


def tangent_frame(normal: Floats) -> Floats:
    """Return a frame (3, 3), whose rows are two axes across a unit vector (3,), and the vector itself."""
    return np.asarray(_tangent_frames(normal[None])[0])
