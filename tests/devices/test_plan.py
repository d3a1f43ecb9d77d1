"""The setpoints of a motion in a file: every row as it was, judged as one, and little of it in memory."""

import itertools
import os
import resource

import numpy as np
import pytest
from palpate_arms.setpoint_buffer import PERIOD, Plan, write_setpoints
from palpate_trajectories import Point

LONG = Point(bias=0.004, amplitude=0.001, frequency=2.0, duration=60.0)


def rows_of(trajectory):
    times = np.arange(int(np.floor(trajectory.total_duration / PERIOD + 1e-9)) + 1) * PERIOD
    setpoint = trajectory.at(times)
    level = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(times), 1))
    return np.column_stack([setpoint.position, setpoint.velocity, setpoint.measuring, level])


def test_a_file_gives_every_row_and_little_of_it_is_held():
    rows = rows_of(LONG)
    with write_setpoints(LONG) as (file, count):
        plan = Plan.in_file(os.dup(file.fileno()), count)
    assert len(plan) == len(rows) > 30_000
    for i in range(len(rows)):
        low, high = plan[i], plan[min(i + 1, len(rows) - 1)]  # as the loop asks for them
        if i % 97 == 0 or i % 512 in (0, 511):
            np.testing.assert_array_equal(low, rows[i])
            np.testing.assert_array_equal(high, rows[min(i + 1, len(rows) - 1)])
    assert sum(len(block) for block in plan._blocks.values()) <= 1024
    np.testing.assert_array_equal(plan[0], rows[0])  # a way back to the start is possible
    plan[0][:] = 1.0
    np.testing.assert_array_equal(plan[0], rows[0])  # a row is a copy


def test_pieces_hold_all_and_what_lies_between_two_of_them():
    rows = rows_of(LONG)
    with write_setpoints(LONG) as (file, count):
        plan = Plan.in_file(os.dup(file.fileno()), count)
    pieces = list(plan.pieces())
    assert len(pieces) > 10
    np.testing.assert_array_equal(np.concatenate([pieces[0], *(piece[2:] for piece in pieces[1:])]), rows)
    for before, after in itertools.pairwise(pieces):
        np.testing.assert_array_equal(before[-2:], after[:2])
    assert plan.fastest == np.linalg.norm(np.diff(rows[:, :3], axis=0), axis=1).max() / PERIOD
    assert plan.lowest == rows[:, 2].min()


@pytest.mark.parametrize("place", [2047, 2048, 2049, 4096, 9000])
def test_a_leap_is_seen_wherever_the_pieces_are_cut(place):
    rows = rows_of(LONG).copy()
    rows[place:, 0] += 0.001
    plan = Plan.of(rows)
    assert plan.fastest > 0.5
    sudden = max(np.abs(np.diff(piece[:, 0], 2)).max() for piece in plan.pieces())
    assert sudden == pytest.approx(0.001)


def test_a_disk_without_room_says_so():
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        with pytest.raises(OSError, match="too large"), write_setpoints(LONG):
            pass
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
