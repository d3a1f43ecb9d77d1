"""`palpate_testing.check_device` on devices that are live: it ends, and asks for no reading twice."""

import itertools
import time
from contextlib import contextmanager

import numpy as np
import pytest
from palpate import Batch, Channel, Device, Stream, clock
from palpate_kit.simulated_time.simulated_clock import SimulatedClock
from palpate_testing import check_device
from palpate_trajectories.point import Point

COUNT = itertools.count()


class _Link:
    def __init__(self, silent, broken):
        self._silent, self._broken = silent, broken

    def batches(self):
        if self._broken:
            raise OSError("unplugged")
        while True:
            time.sleep(0.01)
            if not self._silent:
                stamp = np.array([time.monotonic_ns()])
                yield Batch("wrench", stamp, stamp, np.array([[float(next(COUNT))]]))


class Live(Device):
    """A sensor that never ends."""

    silent: bool = False
    broken: bool = False

    @property
    def live(self):
        """It is."""
        return True

    @property
    def streams(self):
        """One."""
        return (Stream("wrench", (Channel("z", "N"),), 100.0),)

    @contextmanager
    def connect(self, seed=0):
        """A link."""
        yield _Link(self.silent, self.broken)


@pytest.mark.slow
def test_it_ends_and_does_not_ask_for_the_same_readings():
    check_device(Live(), listen=0.2)


@pytest.mark.parametrize(("settings", "words"), [({"silent": True}, "sends nothing"), ({"broken": True}, "unplugged")])
def test_what_is_wrong_with_a_live_device_is_said(settings, words):
    with pytest.raises(AssertionError, match=words):
        check_device(Live(**settings), listen=0.1)


class _Arm:
    """An arm that goes where it is told, at 100 Hz."""

    def __init__(self, how):
        self._how, self._trajectory, self._began, self._stopped = how, None, 0.0, None

    def follow(self, trajectory):
        self._trajectory, self._began = trajectory, clock().now()

    def stop(self):
        self._stopped = self._stopped or clock().now()

    def batches(self):
        while True:
            clock().sleep(0.01)
            now = clock().now()
            if self._stopped is not None and self._how != "deaf":
                now = min(now, self._stopped)
            place = np.array([[0.0, 0.0, 0.03]])
            if self._trajectory is not None:
                place = self._trajectory.at(np.array([now - self._began])).position
            if self._how == "elsewhere":
                place = place + 0.02
            stamp = np.array([clock().now_ns()])
            yield Batch("tip", stamp, stamp, place)


class LiveArm(Device):
    """An arm of somebody else."""

    how: str = "sound"

    @property
    def live(self):
        """It is."""
        return True

    @property
    def streams(self):
        """The pose."""
        return (Stream("tip", tuple(Channel(name, "m") for name in "xyz"), 100.0),)

    @contextmanager
    def connect(self, seed=0):
        """A link."""
        yield _Arm(self.how)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        pytest.param("sound", None, marks=pytest.mark.slow),
        ("deaf", r"LiveArm does not obey: 1 s after `stop` its tip still moves by [\d.]+ mm in 0.3 s"),
        ("elsewhere", "LiveArm does not follow: its tip came to 0% of the places of the motion"),
    ],
)
def test_an_arm_has_to_follow_and_to_stop(how, words):
    press = Point(bias=0.004, amplitude=0.001, clearance=0.005, duration=3.0, standstill=0.0)
    with SimulatedClock().running():
        if words is None:
            check_device(LiveArm(how=how), press)
            return
        with pytest.raises(AssertionError, match=words):
            check_device(LiveArm(how=how), press)


@pytest.mark.slow
def test_the_robot_of_the_twin_follows_and_stops(rig):
    """By its own limits, which `check_device` sets."""
    pipeline = rig.pipeline()
    (press,) = pipeline.trajectories.values()
    check_device(pipeline.devices["arm"], press, listen=4.0)
    assert rig.truth.low[2] < -1e-3
