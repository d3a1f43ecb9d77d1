"""The patch of surface around a point, as a cubic: normal and curvatures, with what the scatter leaves open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Floats

_UNKNOWNS = 10
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
    """The patch around a point (3,) by least squares over neighbours (n, 3) [m], n > 10; its z axis looks outwards.

    Curvatures are eigenvalues of g^-1 h with the first and second fundamental forms g and h at x = y = 0. Terms of
    third order keep the slope right where the curvature changes; those of fourth order are taken for those of a sphere,
    which put a curvature k off by 2/3 k^3 r^2. `heights` (n, n) [m^2] is the covariance of the neighbours' z, besides
    their scatter about the cubic. Source: do Carmo 1976, section 3.3.
    """
    frame = tangent_frame(outwards)
    x, y, z = ((neighbours - point) @ frame.T).T
    scale = float(np.sqrt(np.mean(x * x + y * y)))
    u, v = x / scale, y / scale
    design = np.column_stack([np.ones_like(u), u, v, u * u / 2, u * v, v * v / 2, u**3, u * u * v, u * v * v, v**3])
    values, *_ = np.linalg.lstsq(design, z, rcond=None)
    residual = z - design @ values
    variance = float(residual @ residual) / (len(z) - _UNKNOWNS)
    units = np.repeat([1.0, scale, scale**2, scale**3], [1, 2, 3, 4])
    solver = np.linalg.pinv(design) / units[:, None]
    covariance = variance * solver @ solver.T
    if heights is not None:
        covariance += solver @ heights @ solver.T
        variance += float(covariance[0, 0])
    f, d, e, a, b, c, *_ = values / units
    slope = np.array([d, e])
    length = np.sqrt(1.0 + slope @ slope)
    metric = np.eye(2) + np.outer(slope, slope)
    # Columns of `axes` are the tangents along x and y; a vector's components along them are metric^-1 axes^T.
    axes = frame.T @ np.vstack([np.eye(2), slope])
    inverse = np.linalg.inv(metric)
    hessian = np.array([[a, b], [b, c]])
    shape = -axes @ inverse @ hessian @ inverse @ axes.T / length
    normal = frame.T @ np.array([-d, -e, 1.0]) / length
    curvature, directions = np.linalg.eigh((shape + shape.T) / 2)
    # The eigenvalue of the normal itself is 0, and is left out by its direction.
    across = [i for i in np.argsort(-curvature) if i != np.argmax(np.abs(normal @ directions))]
    spread = [_curvature_std(frame @ directions[:, i], covariance[3:6, 3:6]) for i in across]
    beyond = _HIGHER * np.abs(curvature).max() ** 3 * scale**2
    tilt = -axes @ inverse / length
    return SurfacePatch(
        position=point + f * outwards,
        scatter=float(np.sqrt(variance) / length),
        normal=normal,
        normal_covariance=tilt @ covariance[1:3, 1:3] @ tilt.T,
        shape=shape,
        curvature=curvature[across],
        curvature_std=np.hypot(spread, beyond),
    )


def _curvature_std(direction: Floats, covariance: Floats) -> float:
    """Of the curvature along a direction (3,) of the tangent plane, from the covariance of (a, b, c)."""
    x, y = direction[:2] / max(float(np.linalg.norm(direction[:2])), 1e-12)
    along = np.array([x * x, 2 * x * y, y * y])
    return float(np.sqrt(max(along @ covariance @ along, 0.0)))


def tangent_frame(normal: Floats) -> Floats:
    """(3, 3) rows: two axes across a unit vector (3,), and the vector itself."""
    other = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = other - (other @ normal) * normal
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(normal, x), normal])
