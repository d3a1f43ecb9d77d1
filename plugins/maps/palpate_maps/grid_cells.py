"""Nodes of a grid by their columns and rows: on a surface their coordinates are those of the grid but for rounding."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

Cells = NDArray[np.intp]
"""Column and row (m, 2) of each node of a grid, or of some of its nodes."""


def grid_steps(nodes: Floats, cells: Cells) -> Floats:
    """Return the distances (2,) [m] in x and y of neighbouring nodes (m, k) [m]; infinite along a single one."""
    count = np.ptp(cells, axis=0)
    return np.where(count > 0, np.ptp(nodes[:, :2], axis=0) / np.maximum(count, 1), np.inf)


def thinned(cells: Cells, strides: tuple[int, int]) -> NDArray[np.intp]:
    """Return the rows (j,) of cells (m, 2) in every so many of the columns and rows that have any, from the middle."""
    kept = np.ones(len(cells), bool)
    for along, stride in zip(cells.T, strides, strict=True):
        lines = np.unique(along)
        kept &= np.isin(along, lines[(len(lines) - 1) % stride // 2 :: stride])
    return np.flatnonzero(kept)


def grid_lines(cells: Cells) -> list[NDArray[np.intp]]:
    """Return the nodes of each row and column of cells (m, 2) in their order, cut where a node is missing."""
    lines = []
    for axis in (0, 1):
        steps = np.diff(np.unique(cells[:, axis]))
        for line in np.unique(cells[:, 1 - axis]) if len(steps) else ():
            nodes = np.flatnonzero(cells[:, 1 - axis] == line)
            nodes = nodes[np.argsort(cells[nodes, axis], kind="stable")]
            gaps = np.diff(cells[nodes, axis])
            # A gap of two steps and more lacks a node.
            lines += np.split(nodes, np.flatnonzero(gaps > 1.5 * np.median(steps)) + 1)
    return [line for line in lines if len(line) > 1]
