"""The force along the surface normal, from the whole wrench and the orientation of the tool."""

import numpy as np
import pytest
from palpate import LogError
from palpate_logs.rosbag2_replay import Rosbag2Replay
from palpate_records.messages.turning_frames import FrameOrientations, rotate_vectors
from palpate_testing import check_device

from tests.records.bags import wrench_message, write_bag

WRENCH, POSE = "geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/PoseStamped"
STEP = 2_000_000  # [ns]


def quaternion(angle, axis):
    return np.array([*(np.sin(angle / 2) * np.array(axis)), np.cos(angle / 2)])


def read(path, **signal):
    signals = {"force": {"topic": "/wrench", "field": "wrench.force", "unit": "N", **signal}}
    device = Rosbag2Replay.model_validate({"file": path, "signals": signals})
    check_device(device)
    with device.connect(0) as link:
        batches = list(link.batches())
    return np.concatenate([b.time for b in batches]), np.concatenate([b.values[:, 0] for b in batches])


@pytest.fixture
def bag(tmp_path):
    """A tool that turns about y from 0 to 0.5 rad; the force along the fixed z is 3 N all the time."""
    times = np.arange(0, 1000) * STEP
    wrenches, poses = [], []
    for i, stamp in enumerate(times.tolist()):
        angle = 0.5 * i / 1000
        fixed = np.array([[1.0, 0.5, 3.0]])
        inverse = quaternion(-angle, [0, 1, 0])[None]
        (force,) = rotate_vectors(inverse, fixed)
        wrenches.append((stamp, wrench_message(stamp, "tool0", [*force, 0, 0, 0])))
        if i % 5 == 0:  # poses are slower, and their quaternion changes its sign at will
            sign = 1 if i % 10 else -1
            poses.append((stamp + 1, wrench_message(stamp, "base", [0, 0, 0, *(sign * quaternion(angle, [0, 1, 0]))])))
    return write_bag(tmp_path / "bag.db3", [("/wrench", WRENCH, wrenches), ("/pose", POSE, poses)])


def test_the_normal_force_of_a_tool_that_turns(bag):
    time, force = read(bag, direction=[0, 0, 2], orientation={"topic": "/pose"})
    assert time.tolist() == [i * STEP for i in range(1000)]
    np.testing.assert_allclose(force[:996], 3.0, atol=1e-6)
    assert np.isnan(force[996:]).all()  # after the last pose nobody knows


def test_a_fixed_direction_in_the_frame_of_the_sensor(bag):
    _, force = read(bag, direction=[0, 0, -1])
    assert force[0] == pytest.approx(-3.0)
    assert force[-1] == pytest.approx(-(3.0 * np.cos(0.4995) + np.sin(0.4995)), rel=1e-9)


def test_rotation_by_a_quarter_turn():
    quarter = quaternion(np.pi / 2, [0, 0, 1])[None]
    np.testing.assert_allclose(rotate_vectors(quarter, np.array([[1.0, 0, 0]])), [[0, 1, 0]], atol=1e-15)


def test_orientations_that_are_none_or_late_are_left_out():
    turning = FrameOrientations()
    one = quaternion(0.0, [0, 0, 1])
    turning.learn(np.array([10, 5, 20, 30]), np.array([one, one, 0 * one, one]))
    turning.add(np.array([4, 10, 20, 31]), np.zeros(4, np.int64), np.zeros((4, 3)))
    assert turning.ready() == []
    ((_, _, _, found),) = turning.ready(final=True)
    assert np.isnan(found[:, 0]).tolist() == [True, False, False, True]


@pytest.mark.parametrize(
    ("signal", "words"),
    [
        ({"direction": [0, 0, 1], "orientation": {"topic": "/none"}}, "topic '/none' is not in the log"),
        ({"direction": [0, 0, 1], "orientation": {"topic": "/pose", "field": "q"}}, "have no number 'q.x'"),
        ({"direction": [0, 0, 1], "field": "wrench.force.z"}, "have no number 'wrench.force.z.x'"),
    ],
)
def test_projections_that_do_not_fit(bag, signal, words):
    with pytest.raises(LogError, match=words):
        read(bag, **signal)


@pytest.mark.parametrize("signal", [{"direction": [0, 0, 0]}, {"orientation": {"topic": "/pose"}}])
def test_settings_that_make_no_sense(bag, signal):
    with pytest.raises(ValueError, match="direction"):
        read(bag, **signal)
