"""The number of bodies that the sites of an area show: one more where the evidence asks for it, none without."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_maps.body_field import Body, BodyFit, SiteField, fit_bodies, rise

# Of decision 0570, with the rates of both errors on fields of one and of two bodies.
_EVIDENCE = 10.0  # of the deviance, beyond that of the Bayesian information criterion, that a further body has to gain
MAX_BODIES = 6  # that one group of sites is explained by; what needs as many is a stiff part of the area
_MIN_HEIGHT = 1e-6  # of a logarithm, as a weight: a group without raised sites has a middle, too
_REMAINDER_SHIFT = 1.0  # sigmas by which the other bodies may move where one is taken out
_WINDOW = 3.0  # of a body's sigma: the sites about it that say how many it is
_WINDOW_MARGIN = 8e-3  # [m] beyond that: surroundings
_SPLIT_SHIFT = 1.0  # of its sigma, by which the halves of a body start to either side
_SPLIT_SIGMA = 0.75  # of its sigma, that the halves start with
_SPLIT_CONTRAST = 0.75  # of its contrast
_WIDTHS = 2  # of lumps that one place of the area may hide, narrow and wide: a choice
_DIP_STD = 3.0  # standard deviations of a dip between two bodies, from which on they are two lumps
_DIP_SHARE = 0.1  # of the lower one's height, that the dip has at least
_APART_SHARE = 0.5  # of that height, from which on they are apart: a lump's extent is that at half of its height
_DIP_POINTS = 25  # between two bodies, at which the dip is looked for
_NEIGHBOURS = 12  # sites about a place, whose plane is that of the surface there


def tangents(places: Floats, place: Floats) -> Floats:
    """Return the directions (k, d) in which a body at a place (k,) [m] may lie: x, y, on a surface along its plane."""
    if places.shape[1] < 3:
        return np.eye(places.shape[1])
    # The normal of the plane of the nearest places; x and y of the work frame without their parts along it.
    nearest = np.argsort(((places - place) ** 2).sum(axis=1), kind="stable")[:_NEIGHBOURS]
    normal = np.linalg.svd(places[nearest] - places[nearest].mean(axis=0), full_matrices=False)[2][-1]
    x, y = np.eye(3)[:2]
    along_x = x - (x @ normal) * normal
    along_x /= np.linalg.norm(along_x)
    along_y = y - (y @ normal) * normal - (y @ along_x) * along_x
    return np.column_stack([along_x, along_y / np.linalg.norm(along_y)])


def explain(field: SiteField, groups: Sequence[NDArray[np.intp]], floor: float) -> tuple[BodyFit, list[int]]:
    """Return the fit of as many bodies as groups of stiff sites show, and the number that each shows, at least one.

    First each group has one body. Then each is explained by further bodies, as long as the evidence asks for them, on
    what the bodies of the other groups leave of the sites about it. Each group has the rows of its sites; `floor` is
    the least noise of a site's logarithm.
    """
    bodies = [_start_of(field, group) for group in groups]
    fit = fit_bodies(field, bodies, floor)
    # Group by group, without the other bodies, on the sites about it.
    grown: list[Body] = []
    counts: list[int] = []
    middle = field.middle
    for number, body in enumerate(fit.bodies):
        other_bodies = [*fit.bodies[:number], *fit.bodies[number + 1 :]]
        distance = np.linalg.norm(middle - body.place, axis=1)
        reach = np.linalg.norm(middle[groups[number]] - body.place, axis=1).max()
        window = distance <= max(_WINDOW * body.sigma, float(reach)) + _WINDOW_MARGIN
        local = SiteField(field.place, field.site, field.log - field.mean(rise(other_bodies, field.place)[0]))
        bodies_of_group = _grow(local.chosen(window), body, floor)
        grown += bodies_of_group
        counts.append(len(bodies_of_group))
    # All together, where any group has several.
    if len(grown) > len(fit.bodies):
        return _prune(fit_bodies(field, grown, floor), counts)
    return fit, counts


def _prune(fit: BodyFit, counts: list[int]) -> tuple[BodyFit, list[int]]:
    """Return a fit without the bodies that no evidence asks for once all are fitted; one of each group stays.

    `counts` are the bodies of each group, in the order of the fit's. A body may explain what the first fit of another
    group had left, until that group has bodies of its own.
    """
    group_of_body = np.repeat(np.arange(len(counts)), counts).tolist()  # of each body
    weakest_first = np.argsort([body.contrast for body in fit.bodies], kind="stable").tolist()
    remaining = list(range(len(group_of_body)))
    for k in weakest_first:
        if sum(group_of_body[other] == group_of_body[k] for other in remaining) == 1:
            continue
        row = remaining.index(k)
        fewer = _without(fit, [row])
        if fewer.deviance - fit.deviance < _evidence_needed(fit.bodies[row], len(fit.residual)):
            fit = fewer
            remaining.remove(k)
    remaining_groups = [group_of_body[k] for k in remaining]
    return fit, [remaining_groups.count(number) for number in range(len(counts))]


def _without(fit: BodyFit, members: Sequence[int]) -> BodyFit:
    """Return the fit without some of its bodies; none of the others takes their place."""
    other_bodies = [body for k, body in enumerate(fit.bodies) if k not in members]
    return fit_bodies(fit.field, other_bodies, fit.floor, _REMAINDER_SHIFT)


def _evidence_needed(body: Body, count: int) -> float:
    """Return by how much a further body has to lower the deviance of n sites: p log n (Schwarz 1978), and a margin."""
    return body.size * float(np.log(count)) + _EVIDENCE


def _start_of(field: SiteField, group: NDArray[np.intp]) -> Body:
    """Return the body from which the fit of a group of sites starts: at their middle, as high as the highest."""
    middle, height = field.middle, field.log - np.median(field.log)
    weight = np.maximum(height[group], _MIN_HEIGHT)
    place = weight @ middle[group] / weight.sum()
    # On the surface, not within.
    if middle.shape[1] > 2:
        place = middle[group][int(np.argmin(((middle[group] - place) ** 2).sum(axis=1)))]
    return Body.at(place, float(np.expm1(height[group].max())), tangents(middle, place))


def _grow(field: SiteField, body: Body, floor: float) -> tuple[Body, ...]:
    """Return the bodies that explain the sites about one: one more as long as the evidence asks for it."""
    fit = fit_bodies(field, [body], floor)
    while len(fit.bodies) < MAX_BODIES:
        more = min(
            (fit_bodies(field, bodies, floor) for bodies in _candidates(fit)), key=lambda fitted: fitted.deviance
        )
        needed = _evidence_needed(body, len(field.log))
        if len(field.log) <= len(more.covariance) or fit.deviance - more.deviance < needed:
            break
        fit = more
    return fit.bodies


def _candidates(fit: BodyFit) -> Iterator[list[Body]]:
    """Yield sets of one more body to start from: one at the largest residual, or one of them in halves."""
    middle = fit.field.middle
    largest = int(np.argmax(fit.residual))
    axes = tangents(middle, middle[largest])
    yield [*fit.bodies, Body.at(middle[largest], float(np.expm1(fit.residual[largest])), axes)]
    for number, body in enumerate(fit.bodies):
        other_bodies = [*fit.bodies[:number], *fit.bodies[number + 1 :]]
        shift = _SPLIT_SHIFT * body.sigma * _long_direction(fit, body)
        contrast, sigma = _SPLIT_CONTRAST * body.contrast, _SPLIT_SIGMA * body.sigma
        yield [*other_bodies, *(Body.at(body.place + way * shift, contrast, body.axes, sigma) for way in (-1.0, 1.0))]


def _long_direction(fit: BodyFit, body: Body) -> Floats:
    """Return the direction (k,) in which the sites are longer than a body: of the residuals' largest second moment."""
    offset = (fit.field.middle - body.place) @ body.axes
    # By a Gaussian of twice the body's variance, within which a second body next to it is.
    weight = fit.residual * np.exp(-0.25 * (offset**2).sum(axis=1) / body.sigma**2)
    return np.asarray(body.axes @ np.linalg.eigh((weight[:, None] * offset).T @ offset)[1][:, -1])


def lump_members(fit: BodyFit) -> list[list[int]]:
    """Return the bodies of each lump, the highest first: those that no significant dip of the field parts from it.

    From the highest body down, each is a lump of its own, or joins the lump to which the way over other bodies dips
    least: the dip is that below the body's own height at the lowest point of the best way.
    """
    ways = _Ways.of(fit)
    lumps: list[list[int]] = []
    for k in np.argsort(-ways.height, kind="stable").tolist():
        joined = [lump for lump in lumps if not ways.is_parted(fit, k, lump[0])]
        if joined:
            max(joined, key=lambda lump: ways.saddle[k, lump[0]]).append(k)
        else:
            lumps.append([k])
    return lumps


@dataclass(frozen=True)
class _Ways:
    """The lowest point of the field on the best way from each body to each other."""

    height: Floats  # (K,) of the field's logarithm at the bodies
    slopes: Floats  # (K, p) of these by the unknowns
    saddle: Floats  # (K, K) height of the lowest point of the highest way
    saddle_slopes: Floats  # (K, K, p)

    @classmethod
    def of(cls, fit: BodyFit) -> Self:
        """Return the ways of a fit: straight from body to body, over others where that is higher (Floyd 1962).

        A saddle is the height of the field at the lowest point of a way, with its slopes by the unknowns of all bodies.
        """
        count, unknowns = len(fit.bodies), len(fit.covariance) - 1
        height, slopes = rise(fit.bodies, np.array([body.place for body in fit.bodies]))
        saddle = np.full((count, count), -np.inf)
        saddle_slopes = np.zeros((count, count, unknowns))
        # The lowest point of each straight way.
        for i, j in itertools.permutations(range(count), 2):
            start, end = fit.bodies[i].place, fit.bodies[j].place
            way = start + np.linspace(0.0, 1.0, _DIP_POINTS)[:, None] * (end - start)
            way_height, way_slopes = rise(fit.bodies, way)
            lowest = int(np.argmin(way_height))
            saddle[i, j], saddle_slopes[i, j] = way_height[lowest], way_slopes[lowest]
        # A way over a third body is as high as the lower of its two parts.
        for over, i, j in itertools.permutations(range(count), 3):
            first, second = (i, over), (over, j)
            lower = first if saddle[first] <= saddle[second] else second
            if saddle[lower] > saddle[i, j]:
                saddle[i, j], saddle_slopes[i, j] = saddle[lower], saddle_slopes[lower]
        return cls(height, slopes, saddle, saddle_slopes)

    def is_parted(self, fit: BodyFit, low: int, high: int) -> bool:
        """Return True where the dip on the way from a body to a higher one is larger than its uncertainty.

        Bodies whose places above half of the height do not touch are parted however uncertain the lower one is.
        """
        dip = float(self.height[low] - self.saddle[low, high])
        if dip > _APART_SHARE * float(self.height[low]):
            return True
        std = fit.std_of(self.slopes[low] - self.saddle_slopes[low, high])
        return dip > max(_DIP_STD * std, _DIP_SHARE * float(self.height[low]))


def absence_p(fit: BodyFit, members: Sequence[int]) -> float:
    """Return the p-value of a lump: of the rise of the squares without its bodies, times the places where it could be.

    F = (S0 - S1)/noise^2 with one degree of freedom, its height, and those of the noise, by the distribution of Fisher;
    Bonferroni's correction for its place and width, with as many places as there are sites and two widths.
    """
    from scipy import stats

    without = _without(fit, members)
    square = float(without.residual @ without.residual - fit.residual @ fit.residual)
    places = _WIDTHS * len(fit.residual)
    return min(1.0, places * float(stats.f.sf(max(square, 0.0) / fit.noise**2, 1, fit.freedom)))
