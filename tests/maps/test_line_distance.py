"""The distance between lines: by a search tree what all distances say."""

import numpy as np
import pytest
from palpate_maps.map_grid import line_distance
from palpate_maps.sites import Sites


def by_all_distances(sites):
    """As its docstring says."""
    order, beside = np.arange(len(sites)), 1 if sites.standing.all() else 10
    apart = np.linalg.norm(sites.place[:, None] - sites.place[None], axis=2)
    apart[(np.abs(order[:, None] - order[None]) < beside) | (apart < 1e-4)] = np.inf
    nearest = apart.min(axis=1)
    known = nearest[np.isfinite(nearest)]
    return float(np.quantile(known, 0.9)) if len(known) else 2e-3


def places(kind, count, rng):
    """(n, 2) or (n, 3) [m]."""
    if kind == "lines":
        return np.column_stack([np.tile(np.linspace(0.0, 0.1, 50), 12), np.repeat(np.arange(12), 50) * 2e-3])[:count]
    if kind == "places that come again":
        return np.round(rng.uniform(0.0, 0.01, (count, 2)), 3)
    return rng.uniform(0.0, 0.05, (count, 3))


@pytest.mark.parametrize("kind", ["lines", "places that come again", "anywhere on a surface"])
@pytest.mark.parametrize("standing", [True, False])
@pytest.mark.parametrize("count", [1, 7, 21, 500])
def test_it_is_that_of_all_distances(kind, standing, count):
    place = places(kind, count, np.random.default_rng(count))
    ones = np.ones(len(place))
    sites = Sites(place, ones, ones, ones, np.full(len(place), standing))
    assert line_distance(sites) == by_all_distances(sites)
