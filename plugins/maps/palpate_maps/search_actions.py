"""Actions of a search: points, and lines along the rows of a grid, by their gain in a second."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_maps.grid_cells import Cells, grid_lines
from palpate_maps.search_motion import SearchMotion
from palpate_maps.stiffness_field import lengths_along

# Choices of computing time.
_LONG_ROW = 12  # nodes from which on lines begin and end at every second one: as good, and a quarter as many
_MIN_SHARE = 0.02  # of the gain of all points, below which no line is taken along a row
_ROUNDING = 1e-6  # steps of a grid that a shortest line may lack


class Gain(Protocol):
    """The gain of palpations of nodes of a grid, in any unit."""

    def points(self) -> Floats:
        """Return the gain (m,) of a point at each node."""
        ...

    def sites(self) -> Floats:
        """Return the gain (m,) of one site of a line at each node: of several sites together at most the sum."""
        ...

    def lines(self, row: NDArray[np.intp]) -> Floats:
        """Return the gain (k,) of lines from the first node of a row (k,) to each."""
        ...

    def after(self, node: int) -> Gain:
        """Return the gain once a point was palpated at a node."""
        ...


@dataclass(frozen=True)
class SearchAction:
    """A point, or a line: its gain and its time."""

    start: int  # node
    end: int | None
    gain: float
    seconds: float

    @property
    def worth(self) -> float:
        """Gain in a second."""
        return self.gain / self.seconds


@dataclass(frozen=True)
class ActionGrid:
    """Points at nodes and lines along their rows, with the motions of a rig."""

    nodes: Floats  # (m, 2) [m], of a grid; on a surface (m, 3), of a grid in x and y
    cells: Cells  # (m, 2) column and row of each in the grid
    motion: SearchMotion
    normal: Floats | None = None  # (m, 3) on a surface

    @cached_property
    def _rows(self) -> list[NDArray[np.intp]]:
        """Neighbouring nodes along each axis, in their order."""
        return grid_lines(self.cells)

    def next_round(
        self, gain: Gain, count: int, tip: Floats, closed: NDArray[np.bool_], through: NDArray[np.bool_]
    ) -> list[SearchAction]:
        """Return one line, or up to `count` points, from the tip's place (2,), or on a surface (3,) [m].

        Points are at nodes of `through` (m,) that are not `closed` (m,), and a line goes through a node of `through`.
        Each action is the one that gains most in a second after those before it.
        """
        closed = closed | ~through
        chosen = list[SearchAction]()
        while len(chosen) < count:
            action = self._best(gain, tip, closed, through, bool(chosen))
            if action is None or (chosen and action.end is not None):
                break
            chosen.append(action)
            if action.end is not None:
                break
            closed[action.start], tip = True, self.nodes[action.start]
            gain = gain.after(action.start)
        return chosen

    def _best(
        self, gain: Gain, tip: Floats, closed: NDArray[np.bool_], through: NDArray[np.bool_], further: bool
    ) -> SearchAction | None:
        """Return the point or line that gains most in a second; `further` where points go on without a pause.

        `closed` (m,) are the nodes at which no point may be, `through` (m,) those of which a line has one at least.
        """
        points = gain.points()
        travel = self._travel(tip)
        # The time of a point without a way to it, which the first point and a line have in their own times.
        seconds_on_the_spot = float(self.motion.seconds_to(np.zeros(1))[0])
        seconds = travel if further else self.motion.first_point + travel - seconds_on_the_spot
        best: SearchAction | None = None
        if not closed.all():
            node = int(np.argmax(np.where(closed, -np.inf, points / seconds)))
            best = SearchAction(node, None, float(points[node]), float(seconds[node]))
        if self.motion.line_speed is None:
            return best
        # Rows in the order of the most that a line of each might gain, until none can be better.
        for upper_bound, row in self._promising_rows(points, gain.sites(), through):
            if best is not None and best.worth >= upper_bound:
                break
            line = self._line(row, gain, travel - seconds_on_the_spot, through)
            if line is not None and (best is None or line.worth > best.worth):
                best = line
        return best

    def _promising_rows(
        self, points: Floats, sites: Floats, through: NDArray[np.bool_]
    ) -> list[tuple[float, NDArray[np.intp]]]:
        """Return rows through nodes (m,) whose points gain enough, with the most that a line of each gains."""
        least = _MIN_SHARE * float(points.sum())
        rows = [row for row in self._rows if through[row].any() and float(points[row].sum()) >= least]
        return sorted(((self._most(row, sites), row) for row in rows), key=lambda item: -item[0])

    def _travel(self, tip: Floats) -> Floats:
        """Return the seconds (m,) that a further point takes at each node, from the tip's place and orientation."""
        way = np.hypot.reduce(self.nodes - tip, axis=1)
        if self.normal is not None:
            # Travel and turn go on together: the longer of them counts.
            cosine = self.normal @ self.normal[int(np.argmin(way))]
            way = np.maximum(way, self.motion.way_of_turn * np.arccos(np.clip(cosine, -1.0, 1.0)))
        return self.motion.seconds_to(way)

    def _most(self, row: NDArray[np.intp], sites: Floats) -> float:
        """Return the most that a line along a row gains in a second: as if each of its sites stood alone."""
        along = lengths_along(self.nodes, row)
        sums = np.r_[0.0, np.cumsum(sites[row])]
        first, last = np.triu_indices(len(row), 1)
        seconds = self.motion.seconds_along(np.maximum(along[last] - along[first], self.motion.shortest))
        return float(((sums[last + 1] - sums[first]) / seconds).max())

    def _line(
        self, row: NDArray[np.intp], gain: Gain, travel: Floats, through: NDArray[np.bool_]
    ) -> SearchAction | None:
        """Return the best line along a row; None where none goes through one of some nodes (m,).

        A line goes from one node of the row to another, far enough for the motion; its worth is its gain in a second,
        with the travel [s] to the end of it that is nearer in time. Of a long row every second node is an end.
        """
        along = lengths_along(self.nodes, row)
        step = float(np.hypot(*(self.nodes[row[1], :2] - self.nodes[row[0], :2])))
        min_steps = max(int(np.ceil(self.motion.shortest / step - _ROUNDING)), 1)
        stride = 2 if len(row) > _LONG_ROW else 1  # nodes
        best: SearchAction | None = None
        for first in range(0, len(row) - min_steps, stride):
            last = np.arange(first + min_steps, len(row), stride)
            crosses = np.logical_or.accumulate(through[row[first:]])[min_steps::stride]
            if not crosses.any():
                continue
            # Gain and duration of the lines from this place to each of the last ones.
            gains = np.where(crosses, gain.lines(row[first:])[min_steps::stride], -np.inf)
            way_there = np.minimum(travel[row[first]], travel[row[last]])
            seconds = self.motion.seconds_along(along[last] - along[first]) + way_there
            # Of the lines from this place the best, begun at the end that is nearer in time.
            k = int(np.argmax(gains / seconds))
            start, end = int(row[first]), int(row[last[k]])
            if travel[start] > travel[end]:
                start, end = end, start
            line = SearchAction(start, end, float(gains[k]), float(seconds[k]))
            if best is None or line.worth > best.worth:
                best = line
        return best
