"""What a track says of a sweep: of its places, whatever the blocks, and of the last sample only under its own name."""

from itertools import pairwise

import numpy as np
import pytest
from palpate_maps.path_estimates import PathEstimates


def way(time, place, values, cuts=()):
    made = PathEstimates()
    edges = [0, *cuts, len(time)]
    for first, last in pairwise(edges):
        made.add(time[first:last], place[first:last], values[first:last])
    return made


TIME = np.arange(0.0, 12.0, 0.002)
PLACE = np.column_stack([np.maximum(TIME - 2.0, 0.0) * 2e-3, 0 * TIME])  # a stay of 2 s, then 20 mm at 2 mm/s
VALUES = np.column_stack([1e5 * (1 + PLACE[:, 0] / 20e-3), 1e3 + 0 * TIME])


def test_every_place_counts_once():
    """The mean of a ramp over the way is its middle, and a long stay at the beginning has no more weight."""
    numbers = way(TIME, PLACE, VALUES).numbers
    assert len(numbers) == 21
    assert numbers[:, 0].mean() == pytest.approx(1.5e5, rel=0.02)


@pytest.mark.parametrize("seed", range(5))
def test_blocks_change_no_bit(seed):
    cuts = np.sort(np.random.default_rng(seed).choice(np.arange(1, len(TIME)), 300, replace=False))
    np.testing.assert_array_equal(way(TIME, PLACE, VALUES, cuts).numbers, way(TIME, PLACE, VALUES).numbers)


def test_the_first_second_and_what_is_nowhere_do_not_count():
    cold = VALUES.copy()
    cold[TIME < 0.5] = 9e9
    moved = PLACE + np.column_stack([np.where(TIME < 0.5, -5e-3, 0.0), 0 * TIME])  # while cold at another place
    assert way(TIME, moved, cold).numbers.max() < 3e5
    nowhere = np.full_like(PLACE, np.nan)
    assert not len(way(TIME, nowhere, VALUES).numbers)
