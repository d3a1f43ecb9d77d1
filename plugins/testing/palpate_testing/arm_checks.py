"""Checks of arms: whether the tip goes where the motion has it, and whether it stands once it is stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from palpate import (
    RETREAT,
    RETREAT_SPEED,
    Arm,
    ArmLimits,
    Batch,
    Device,
    DeviceError,
    Floats,
    Retractable,
    SupportsLimits,
    SupportsRetreat,
    Trajectory,
    clock,
    duration_of,
    setpoints_at,
)

from palpate_testing.failure_messages import demand

_AWAY = 1e-3  # [m] that the tip may be from where the motion has it
_BEGUN = 0.2  # of the farthest place of a motion from its start, at which the arm is stopped
_REACTS, _LOOKS = 1.0, 0.3  # [s] for braking, and of the look whether the tip stands
_STANDS = 0.2e-3  # [m]
_FIRST = 0.3  # [s] for the first batches
_ROOM = 0.1  # [m] around a motion, for the way to its start
_STEP = 2e-3  # [s]
_OFF_WAY = 0.2e-3  # [m] that a tip may be off the way of the first retreat
_REPORTS = 10  # places of which one is the mean
_SHORT, _RETRACTS = 0.05, 3.0  # [s] of looks before and after a retraction begins
_TELLS = 1.0  # [s] until a lost link is reported


@dataclass(frozen=True)
class ArmTest:
    """What a test knows of an arm besides what its driver says."""

    tip: Callable[[], Floats]  # where the tip truly is (3,) [m], in the work frame
    cut: Callable[[], object]  # cuts the link to the controller


def set_out(link: Arm, trajectory: Trajectory) -> None:
    """Let an arm that is listened to follow a motion, as a run does: once it has said where it stands.

    One that keeps limits by itself gets those of the motion, with room for the way to its start.
    """
    clock().sleep(_FIRST)
    _set_limits(link, trajectory)
    link.follow(trajectory)


def _set_limits(link: Arm, trajectory: Trajectory) -> None:
    if isinstance(link, SupportsLimits):
        time, place, speed = _motion(trajectory)
        sudden = np.linalg.norm(np.diff(speed, axis=0), axis=1).max(initial=0.0) / float(time[1] - time[0])
        low, high = (tuple((side - _ROOM * sign).tolist()) for side, sign in ((place.min(0), 1), (place.max(0), -1)))
        fastest = float(np.linalg.norm(speed, axis=1).max())
        link.limit(ArmLimits(low, high, 1.1 * fastest, 1.1 * float(sudden), 0.1, 0.2), lambda reason: None)


def check_follows(device: Device, batches: Sequence[Batch], trajectory: Trajectory, is_whole: bool) -> None:
    """The tip has gone to the farthest place of a motion, or, where it was not listened to the end, towards it."""
    name, seen = type(device).__name__, places(device, batches)
    demand(len(seen), f"{name} moves, and sends no position of its tip")
    _, place, _ = _motion(trajectory)
    apart = np.linalg.norm(seen[:, None] - place[None, :: max(len(place) // 200, 1)], axis=2).min(axis=0)
    share = float((apart < _AWAY).mean())
    least = 0.95 if is_whole else 0.05
    demand(share >= least, f"{name} does not follow: its tip came to {share:.0%} of the places of the motion")


class _MovedArm:
    """An arm on its way through a motion: what it sends, and where a test sees it."""

    def __init__(
        self,
        device: Device,
        link: Arm,
        trajectory: Trajectory,
        arm: ArmTest | None,
        begin: Callable[[Arm, Trajectory], None] = set_out,
    ) -> None:
        self.name, self.link = type(device).__name__, link
        self.failure: DeviceError | None = None
        self.ended = False
        self._device, self._arm = device, arm
        self._heard: list[Batch] = []
        _, self._motion, _ = _motion(trajectory)
        clock().thread(self._hear, f"{self.name} is moved").start()
        begin(link, trajectory)

    def _hear(self) -> None:
        try:
            for batch in self.link.batches():
                self._heard.append(batch)
        except DeviceError as failure:  # an arm that was stopped may say so
            self.failure = failure
        self.ended = True

    def wait_until_begun(self, seconds: float) -> None:
        """Until a part of the way from the start of the motion is gone."""
        start, deadline = self._motion[0], clock().now() + seconds
        farthest = float(np.linalg.norm(self._motion - start, axis=1).max())
        while clock().now() < deadline:
            seen = places(self._device, list(self._heard))
            away = np.linalg.norm(seen - start, axis=1)
            if len(seen) and away.min() < _AWAY and away[-1] > _BEGUN * farthest > 0.0:
                return
            if self.failure is not None:
                raise AssertionError(f"{self.name} does not begin the motion: {self.failure}")
            clock().sleep(0.01)
        raise AssertionError(f"{self.name} has not begun the motion within {seconds:g} s")

    def reported_way(self) -> Floats:
        """Return how far (3,) [m] the tip has gone since the first of its batches, as the arm says."""
        reported = places(self._device, list(self._heard))
        return np.asarray(reported[-_REPORTS:].mean(axis=0) - reported[:_REPORTS].mean(axis=0))

    def look(self, seconds: float) -> Floats:
        """Where the tip is meanwhile (n, 3) [m]: as the test sees it, or else as the arm says."""
        before, deadline = len(self._heard), clock().now() + seconds
        seen = []
        while clock().now() < deadline:
            clock().sleep(0.01)
            if self._arm is not None:
                seen.append(np.array(self._arm.tip(), float))
        return np.array(seen) if self._arm is not None else places(self._device, list(self._heard)[before:])

    def demand_standstill(self, after: str) -> None:
        """The tip stands once it has had time to brake."""
        clock().sleep(_REACTS)
        rest = self.look(_LOOKS)
        moved = float(np.ptp(rest, axis=0).max()) if len(rest) else 0.0
        demand(
            moved < _STANDS,
            f"{self.name} does not obey: {_REACTS:g} s after {after} its tip still moves by {1e3 * moved:.1f} mm in "
            f"{_LOOKS:g} s",
        )


@contextmanager
def _moved(
    device: Device, trajectory: Trajectory, seed: int, listen: float, arm: ArmTest | None
) -> Iterator[_MovedArm]:
    """An arm that has begun a motion."""
    with device.connect(seed) as link:
        assert isinstance(link, Arm)
        moved = _MovedArm(device, link, trajectory, arm)
        moved.wait_until_begun(listen)
        yield moved


def check_obeys(device: Device, trajectory: Trajectory, seed: int, arm: ArmTest | None) -> None:
    """An arm that can retreat does it first: outwards, as far as commanded at most, and as far as it says."""

    def begin(link: Arm, trajectory: Trajectory) -> None:
        clock().sleep(_FIRST)
        _set_limits(link, trajectory)

    with device.connect(seed) as link:
        if not isinstance(link, Arm) or not isinstance(link, SupportsRetreat):
            return
        moved = _MovedArm(device, link, trajectory, arm, begin)
        before = moved.look(_SHORT)
        way = moved.look(link.retreat(RETREAT, RETREAT_SPEED) + _SHORT) - before.mean(axis=0)
        apart = float(np.linalg.norm(way[-1] - moved.reported_way()))
        link.stop()
        clock().sleep(_REACTS)
        demand(moved.failure is None, f"{moved.name} does not obey: {moved.failure}")
        farthest = float(np.linalg.norm(way - np.clip(way, 0.0, (0.0, 0.0, RETREAT)), axis=1).max())
        demand(
            farthest < _OFF_WAY,
            f"{moved.name} does not obey: in its first retreat, of {1e3 * RETREAT:g} mm outwards, its tip was "
            f"{1e3 * farthest:.2f} mm off that way",
        )
        demand(
            apart < _OFF_WAY,
            f"{moved.name} does not report where its tip is: after its first retreat it has gone another way than it "
            f"says, by {1e3 * apart:.2f} mm",
        )


def check_stops(device: Device, trajectory: Trajectory, seed: int, listen: float, arm: ArmTest | None = None) -> None:
    """An arm that is stopped on its way stands soon."""
    with _moved(device, trajectory, seed, listen, arm) as moved:
        moved.link.stop()
        moved.demand_standstill("`stop`")


def check_retracts(device: Device, trajectory: Trajectory, seed: int, listen: float, arm: ArmTest | None) -> None:
    """An arm that can leave the material goes back to the height at which its motion began, and stands there."""
    with _moved(device, trajectory, seed, listen, arm) as moved:
        if not isinstance(moved.link, Retractable):
            return
        before = moved.look(_SHORT)[-1]
        moved.link.retract()
        after = moved.look(_RETRACTS)
        wanted, came = _motion(trajectory)[1][0, 2], float(after[:, 2].max()) if len(after) else float(before[2])
        demand(
            came > wanted - _AWAY,
            f"{moved.name} does not retract: from {1e3 * before[2]:.1f} mm its tip came to {1e3 * came:.1f} mm within "
            f"{_RETRACTS:g} s of `retract`, and {1e3 * wanted:.1f} mm is where the motion began",
        )
        moved.demand_standstill("`retract`")


def check_link_loss(device: Device, trajectory: Trajectory, seed: int, listen: float, arm: ArmTest) -> None:
    """An arm whose link to its controller is cut says so, and stands."""
    with _moved(device, trajectory, seed, listen, arm) as moved:
        arm.cut()
        deadline = clock().now() + _TELLS
        while clock().now() < deadline and not moved.ended:
            clock().sleep(0.01)
        demand(
            moved.failure is not None,
            f"{moved.name} does not report a lost link: {_TELLS:g} s after it was cut "
            + ("its batches ended without a word" if moved.ended else "its batches go on"),
        )
        moved.demand_standstill("its link was cut")


def places(device: Device, batches: Sequence[Batch]) -> Floats:
    """Positions (n, 3) [m] of the tip, of the first stream that measures x, y and z; none without such a stream."""
    for stream in device.streams:
        columns = {one.name: k for k, one in enumerate(stream.channels) if one.unit == "m"}
        if set("xyz") <= columns.keys() and not stream.estimated:
            axes = [columns[axis] for axis in "xyz"]
            found = [batch.values[:, axes] for batch in batches if batch.stream == stream.name]
            return np.concatenate(found) if found else np.zeros((0, 3))
    return np.zeros((0, 3))


def _motion(trajectory: Trajectory) -> tuple[Floats, Floats, Floats]:
    time = np.arange(0.0, duration_of(trajectory), _STEP)
    setpoint = setpoints_at(trajectory, time)
    return time, setpoint.position, setpoint.velocity
