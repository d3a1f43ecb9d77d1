"""Grids of nodes, and areas of them."""

import numpy as np
from palpate_maps.search_area import Area
from palpate_maps.search_skin import SearchSkin


def cells_of(nodes):
    """Column and row (m, 2) of nodes (m, 2) whose coordinates are exactly those of a grid."""
    return np.column_stack([np.unique(along, return_inverse=True)[1] for along in nodes.T])


def everywhere(places):
    """Every place is allowed."""
    return np.ones(len(places), bool)


def plate(nodes, allows=everywhere):
    """The area of all nodes (m, 2) [m]."""
    return Area(nodes, cells_of(nodes), "the plate", allows)


def skin_over(surface, nodes):
    """The area of all nodes (m, 2) [m] on a surface."""
    points = surface.uppermost(nodes)
    skin = SearchSkin.at(surface, points, np.ones(len(nodes), bool))
    return Area(points.position, cells_of(nodes), "the plate", everywhere, skin=skin)
