"""Lumps of an area by the bodies that are fitted to all of its sites together with the background."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from palpate import Floats

from palpate_maps.body_field import FWHM, Body, BodyFit, rise
from palpate_maps.body_search import absence_p
from palpate_maps.lump_criteria import Lump, size_without_tip

_HALF_HEIGHT = 0.5  # of a lump: its extent is that of the places above
_GRID_STEP = 5e-4  # [m] of the grid over a lump of several bodies: a twentieth of a usual body's width (choice)
_MARGIN_SIGMAS = 1.5  # of a body's sigma, by which that grid goes beyond its middle: half height is at 1.18


def body_lump(fit: BodyFit, members: Sequence[int], points: Floats, contact_radius: float | None = None) -> Lump:
    """Return the lump of some bodies of a fit; `points` (j, k) [m] are the places of point palpations.

    `members` are the bodies' numbers in the fit. The lump's place is uncertain as that of its highest body is, whose
    unknowns are shifts along its axes, its contrast and, last, the logarithm of its sigma. Its own size is without the
    blur of a tip's contact of a radius [m].
    """
    bodies = [fit.bodies[k] for k in members]
    number = max(members, key=lambda k: _contrast(bodies, fit.bodies[k].place[None])[0])
    highest, rows = fit.bodies[number], fit.rows_of(number)
    contrast, slopes = _peak(fit, members, highest.place)
    body_covariance = fit.covariance[rows, rows]
    # Standard deviations of x and y: on a surface, of the directions in its plane as seen from above.
    place_variance = np.diag(highest.axes @ body_covariance[:-2, :-2] @ highest.axes.T)[:2]
    middle, extent, axes = _shape(bodies, highest, contrast)
    is_on_lump = _contrast(bodies, points) >= _HALF_HEIGHT * contrast if len(points) else np.zeros(0, bool)
    return Lump(
        place=(float(middle[0]), float(middle[1])),
        extent=extent,
        contrast=contrast,
        contrast_std=fit.std_of(slopes),
        p=absence_p(fit, members),
        checked=bool(is_on_lump.any()),
        highest=(float(highest.place[0]), float(highest.place[1])),
        height=float(middle[2]) if len(middle) > 2 else None,
        axes=axes,
        place_std=(float(np.sqrt(place_variance[0])), float(np.sqrt(place_variance[1]))),
        width_std=float(np.sqrt(body_covariance[-1, -1])),
        size=own_size(bodies, float(np.sqrt(body_covariance[-1, -1])), contact_radius),
        bodies=tuple(bodies),
    )


def own_size(bodies: Sequence[Body], relative_std: float, contact_radius: float | None) -> tuple[float, float] | None:
    """Return the size [m] of a single body without the tip's blur, with its standard deviation; None if not known."""
    if len(bodies) > 1 or contact_radius is None:
        return None
    width = FWHM * bodies[0].sigma
    return size_without_tip(width, width * relative_std, contact_radius)


def _contrast(bodies: Sequence[Body], places: Floats) -> Floats:
    """Return the contrast (m,) of bodies at places (m, k) [m]."""
    return np.asarray(np.expm1(rise(bodies, places)[0]))


def _peak(fit: BodyFit, members: Sequence[int], place: Floats) -> tuple[float, Floats]:
    """Return the contrast of some bodies at a place (k,) [m], and its slopes (p,) by all bodies' unknowns."""
    height, slopes = rise([fit.bodies[k] for k in members], place[None])
    contrast = float(np.expm1(height[0]))
    columns = np.concatenate([np.arange(fit.rows_of(k).start, fit.rows_of(k).stop) for k in members]) - 1
    all_slopes = np.zeros(len(fit.covariance) - 1)
    all_slopes[columns] = (1 + contrast) * slopes[0]
    return contrast, all_slopes


def _shape(
    bodies: Sequence[Body], highest: Body, contrast: float
) -> tuple[Floats, tuple[float, float], tuple[float, float]]:
    """Return the middle (k,) of a lump, the extents along x and y, and those along and across its main axis [m].

    The lump is what lies above half of its height: of `contrast`, that of all its bodies together at the place of the
    `highest` one.
    """
    width = FWHM * highest.sigma
    if len(bodies) == 1:
        return highest.place, (width, width), (width, width)
    # Of several bodies: the places above half of the height, on a grid in the tangent plane of the highest.
    offsets = np.array([highest.axes.T @ (body.place - highest.place) for body in bodies])
    margin = np.array([_MARGIN_SIGMAS * body.sigma for body in bodies])[:, None]
    low, high = (offsets - margin).min(axis=0), (offsets + margin).max(axis=0)
    x, y = np.meshgrid(np.arange(low[0], high[0], _GRID_STEP), np.arange(low[1], high[1], _GRID_STEP))
    places = highest.place + np.column_stack([x.ravel(), y.ravel()]) @ highest.axes.T
    inside = places[_contrast(bodies, places) >= _HALF_HEIGHT * contrast]
    middle = inside.mean(axis=0)
    # Each place stands for a cell of the grid, so that half a cell is added at either end.
    extent = np.ptp(inside[:, :2], axis=0) + _GRID_STEP
    # Along the main axes of these places: the eigenvectors of their covariance, the narrower one first.
    directions = np.linalg.eigh(np.cov(inside[:, :2].T))[1]
    across, along = (np.ptp(inside[:, :2] @ directions, axis=0) + _GRID_STEP).tolist()
    return middle, (float(extent[0]), float(extent[1])), (along, across)
