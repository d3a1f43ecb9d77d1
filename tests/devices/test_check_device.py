"""`palpate_testing.check_device` on devices that are live: it ends, and asks for no reading twice."""

import itertools
import time
from contextlib import contextmanager

import numpy as np
import pytest
from palpate import Batch, Channel, Device, DeviceError, Stream, clock
from palpate_kit.simulated_time.simulated_clock import SimulatedClock
from palpate_testing import ArmTest, check_device
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
                count = next(COUNT)
                measured = np.array([10_000_000 * count])  # by its own clock: a busy machine delays the arrival alone
                yield Batch("wrench", measured, np.array([time.monotonic_ns()]), np.array([[float(count)]]))


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
    """An arm that goes where it is told, at 100 Hz, and back up at 20 mm/s."""

    made = []  # noqa: RUF012

    def __init__(self, how):
        self._how, self._trajectory, self._began, self._stopped, self._retracts = how, None, 0.0, None, None
        self.cut = False
        self.made.append(self)

    def follow(self, trajectory):
        self._trajectory, self._began = trajectory, clock().now()

    def stop(self):
        self._stopped = self._stopped or clock().now()

    def retract(self):
        self._retracts = self._retracts or clock().now()
        self.stop()

    def lose_link(self):
        """Its controller stops it where commands stay away."""
        self.cut = True
        self.stop()

    def tip(self):
        now = clock().now()
        if self._trajectory is None or self._how == "still":
            return np.array([0.0, 0.0, 0.03])
        until = now if self._stopped is None or self._how == "deaf" else min(now, self._stopped)
        place = self._trajectory.at(np.array([until - self._began])).position[0]
        top = self._trajectory.at(np.zeros(1)).position[0]
        if self._retracts is not None and self._how != "stays":
            place[2] = min(place[2] + 0.02 * (now - self._retracts), top[2])
        return place + (0.02 if self._how == "elsewhere" else 0.0)

    def batches(self):
        while True:
            clock().sleep(0.01)
            if self.cut and self._how != "mute":
                raise DeviceError("the link is lost")
            stamp = np.array([clock().now_ns()])
            yield Batch("tip", stamp, stamp, self.tip()[None])


class LiveArm(Device):
    """An arm of somebody else, that has nothing of palpate's kit."""

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
        ("still", "LiveArm does not follow: its tip came to"),
        ("stays", r"LiveArm does not retract: from [\d.]+ mm its tip came to [\d.]+ mm within 3 s of `retract`"),
        ("mute", "LiveArm does not report a lost link: 1 s after it was cut its batches go on"),
    ],
)
def test_an_arm_has_to_follow_stop_retract_and_report_a_lost_link(how, words):
    press = Point(bias=0.004, amplitude=0.001, clearance=0.005, duration=3.0, standstill=0.0)
    arm = ArmTest(tip=lambda: _Arm.made[-1].tip(), cut=lambda: _Arm.made[-1].lose_link())
    with SimulatedClock().running():
        if words is None:
            check_device(LiveArm(how=how), press, arm=arm)
            return
        with pytest.raises(AssertionError, match=words):
            check_device(LiveArm(how=how), press, arm=arm)


@pytest.mark.slow
def test_the_robot_of_the_twin_follows_and_stops(rig):
    """By its own limits, which `check_device` sets."""
    pipeline = rig.pipeline()
    (press,) = pipeline.trajectories.values()
    check_device(pipeline.devices["arm"], press, listen=4.0)
    assert rig.truth.low[2] < -1e-3
