"""Checks of arms: the tip follows the motion, and stands once it is stopped."""

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

# Choices of the checks, wide enough for any arm in order: a few times the lag and the noise of a slow one.
MAX_DEVIATION = 1e-3  # [m] of the tip from the path of the motion
BEGUN_SHARE = 0.2  # of the largest distance of a motion from its start, at which the arm is stopped
FOLLOWED_SHARE, BEGUN_FOLLOWED_SHARE = 0.95, 0.05  # of a motion's places, of a whole motion and of its beginning
BRAKING_TIME = 1.0  # [s]
STANDSTILL_TIME, STANDSTILL_RANGE = 0.3, 0.2e-3  # [s] of watching a tip that stands, and [m] that it may move in it
CONNECTION_TIME = 0.3  # [s] for the first batches
APPROACH_ROOM = 0.1  # [m] around a motion, for the path to its start
LIMIT_MARGIN = 1.1  # times the speed and the acceleration of a motion
MAX_TURN, MAX_TURN_SPEED = 0.1, 0.2  # [rad], [rad/s] of the tool
MAX_COMPARED_PLACES = 200  # of a motion, for speed
SETPOINT_STEP = 2e-3  # [s]
RETREAT_DEVIATION = 0.2e-3  # [m] of a tip from the path of the first retreat
AVERAGED_REPORTS = 10  # positions, for less noise
BRIEF_TIME, RETRACTION_TIME = 0.05, 3.0  # [s] of watching before and during a retraction
REPORT_TIME = 1.0  # [s] until a lost link is reported
WATCH_STEP = 0.01  # [s] between two looks


@dataclass(frozen=True)
class ArmTest:
    """Knowledge of a test about an arm, independent of its driver."""

    tip: Callable[[], Floats]  # returns the true position of the tip (3,) [m] in the work frame
    cut: Callable[[], object]  # cuts the link to the controller


def set_out(link: Arm, trajectory: Trajectory) -> None:
    """Let an arm whose batches are read follow a motion, as a run does: after its first positions.

    An arm that keeps limits by itself gets those of the motion, with room for the path to its start.
    """
    clock().sleep(CONNECTION_TIME)
    _set_limits(link, trajectory)
    link.follow(trajectory)


def _set_limits(link: Arm, trajectory: Trajectory) -> None:
    """Give an arm that keeps limits by itself those of a motion, with a margin."""
    if not isinstance(link, SupportsLimits):
        return
    time, position, velocity = _motion(trajectory)
    acceleration = np.linalg.norm(np.diff(velocity, axis=0), axis=1).max(initial=0.0) / float(time[1] - time[0])
    speed = float(np.linalg.norm(velocity, axis=1).max())
    limits = ArmLimits(
        tuple((position.min(0) - APPROACH_ROOM).tolist()),
        tuple((position.max(0) + APPROACH_ROOM).tolist()),
        LIMIT_MARGIN * speed,
        LIMIT_MARGIN * float(acceleration),
        MAX_TURN,
        MAX_TURN_SPEED,
    )
    link.limit(limits, lambda reason: None)


def check_follows(device: Device, batches: Sequence[Batch], trajectory: Trajectory, is_whole: bool) -> None:
    """Check that the tip came to nearly all places of a motion, or to some where only its beginning was recorded."""
    name, positions = type(device).__name__, places(device, batches)
    demand(len(positions), f"{name} moves, and sends no position of its tip")
    _, path, _ = _motion(trajectory)
    compared = path[:: max(len(path) // MAX_COMPARED_PLACES, 1)]
    distance = np.linalg.norm(positions[:, None] - compared[None], axis=2).min(axis=0)
    share = float((distance < MAX_DEVIATION).mean())
    expected_share = FOLLOWED_SHARE if is_whole else BEGUN_FOLLOWED_SHARE
    demand(share >= expected_share, f"{name} does not follow: its tip came to {share:.0%} of the places of the motion")


class _MovedArm:
    """Arm that moves: the batches that it sends, and the true position of its tip, where a test knows it.

    `start` sets the arm in motion, once its batches are read.
    """

    def __init__(
        self,
        device: Device,
        link: Arm,
        trajectory: Trajectory,
        arm: ArmTest | None,
        start: Callable[[Arm, Trajectory], None] = set_out,
    ) -> None:
        self.name, self.link = type(device).__name__, link
        self.failure: DeviceError | None = None  # by which the batches ended
        self.ended = False  # the batches have ended
        self._device, self._arm = device, arm
        self._batches: list[Batch] = []
        _, self._path, _ = _motion(trajectory)  # (n, 3) [m]
        clock().thread(self._read, f"{self.name} is moved").start()
        start(link, trajectory)

    def _read(self) -> None:
        """Read batches until the arm ends them or fails."""
        try:
            for batch in self.link.batches():
                self._batches.append(batch)
        except DeviceError as failure:  # an arm that was stopped may say so
            self.failure = failure
        self.ended = True

    def wait_until_begun(self, seconds: float) -> None:
        """Wait until the tip was at the start of the motion and is a part of the largest distance away from it.

        Raises AssertionError after some seconds, or where the arm fails.
        """
        start, deadline = self._path[0], clock().now() + seconds
        largest_distance = float(np.linalg.norm(self._path - start, axis=1).max())
        while clock().now() < deadline:
            positions = places(self._device, list(self._batches))
            distance = np.linalg.norm(positions - start, axis=1)
            was_at_start = len(positions) > 0 and distance.min() < MAX_DEVIATION
            if was_at_start and distance[-1] > BEGUN_SHARE * largest_distance > 0.0:
                return
            if self.failure is not None:
                raise AssertionError(f"{self.name} does not begin the motion: {self.failure}")
            clock().sleep(WATCH_STEP)
        raise AssertionError(f"{self.name} has not begun the motion within {seconds:g} s")

    def reported_displacement(self) -> Floats:
        """Return the displacement (3,) [m] of the tip since the first of its batches, as the arm reports it."""
        positions = places(self._device, list(self._batches))
        return np.asarray(positions[-AVERAGED_REPORTS:].mean(axis=0) - positions[:AVERAGED_REPORTS].mean(axis=0))

    def watch(self, seconds: float) -> Floats:
        """Return the positions (n, 3) [m] of the tip in some seconds: true ones, or else those that the arm sends."""
        first_batch, deadline = len(self._batches), clock().now() + seconds
        true_positions = []
        while clock().now() < deadline:
            clock().sleep(WATCH_STEP)
            if self._arm is not None:
                true_positions.append(np.array(self._arm.tip(), float))
        if self._arm is not None:
            return np.array(true_positions)
        return places(self._device, list(self._batches)[first_batch:])

    def demand_standstill(self, after: str) -> None:
        """Raise AssertionError if the tip moves after the time for braking; `after` names the reason to stop."""
        clock().sleep(BRAKING_TIME)
        positions = self.watch(STANDSTILL_TIME)
        moved = float(np.ptp(positions, axis=0).max()) if len(positions) else 0.0
        demand(
            moved < STANDSTILL_RANGE,
            f"{self.name} does not obey: {BRAKING_TIME:g} s after {after} its tip still moves by {1e3 * moved:.1f} mm "
            f"in {STANDSTILL_TIME:g} s",
        )


@contextmanager
def _moved(
    device: Device, trajectory: Trajectory, seed: int, listen: float, arm: ArmTest | None
) -> Iterator[_MovedArm]:
    """Yield an arm that has begun a motion within `listen` seconds."""
    with device.connect(seed) as link:
        assert isinstance(link, Arm)
        moved = _MovedArm(device, link, trajectory, arm)
        moved.wait_until_begun(listen)
        yield moved


def check_obeys(device: Device, trajectory: Trajectory, seed: int, arm: ArmTest | None) -> None:
    """Check that an arm that can retreat goes outwards, as far as commanded at most, and as far as it reports."""

    def prepare(link: Arm, trajectory: Trajectory) -> None:
        """Give the arm its limits after its first positions; it does not move."""
        clock().sleep(CONNECTION_TIME)
        _set_limits(link, trajectory)

    with device.connect(seed) as link:
        if not isinstance(link, Arm) or not isinstance(link, SupportsRetreat):
            return
        moved = _MovedArm(device, link, trajectory, arm, prepare)
        start = moved.watch(BRIEF_TIME).mean(axis=0)
        displacement = moved.watch(link.retreat(RETREAT, RETREAT_SPEED) + BRIEF_TIME) - start
        report_error = float(np.linalg.norm(displacement[-1] - moved.reported_displacement()))
        link.stop()
        clock().sleep(BRAKING_TIME)
        demand(moved.failure is None, f"{moved.name} does not obey: {moved.failure}")
        # The retreat is along z, from 0 to its length.
        on_path = np.clip(displacement, 0.0, (0.0, 0.0, RETREAT))
        deviation = float(np.linalg.norm(displacement - on_path, axis=1).max())
        demand(
            deviation < RETREAT_DEVIATION,
            f"{moved.name} does not obey: in its first retreat, of {1e3 * RETREAT:g} mm outwards, its tip was "
            f"{1e3 * deviation:.2f} mm off that way",
        )
        demand(
            report_error < RETREAT_DEVIATION,
            f"{moved.name} does not report where its tip is: after its first retreat it has gone another way than it "
            f"says, by {1e3 * report_error:.2f} mm",
        )


def check_stops(device: Device, trajectory: Trajectory, seed: int, listen: float, arm: ArmTest | None = None) -> None:
    """Check that an arm stands soon after it was stopped within a motion."""
    with _moved(device, trajectory, seed, listen, arm) as moved:
        moved.link.stop()
        moved.demand_standstill("`stop`")


def check_retracts(device: Device, trajectory: Trajectory, seed: int, listen: float, arm: ArmTest | None) -> None:
    """Check that an arm that can retract goes back to the height at which its motion began, and stands there."""
    with _moved(device, trajectory, seed, listen, arm) as moved:
        if not isinstance(moved.link, Retractable):
            return
        height_before = moved.watch(BRIEF_TIME)[-1][2]
        moved.link.retract()
        positions = moved.watch(RETRACTION_TIME)
        height = float(positions[:, 2].max()) if len(positions) else float(height_before)
        start_height = _motion(trajectory)[1][0, 2]
        demand(
            height > start_height - MAX_DEVIATION,
            f"{moved.name} does not retract: from {1e3 * height_before:.1f} mm its tip came to {1e3 * height:.1f} mm "
            f"within {RETRACTION_TIME:g} s of `retract`, and {1e3 * start_height:.1f} mm is where the motion began",
        )
        moved.demand_standstill("`retract`")


def check_link_loss(device: Device, trajectory: Trajectory, seed: int, listen: float, arm: ArmTest) -> None:
    """Check that an arm reports that the link to its controller was cut, and stands."""
    with _moved(device, trajectory, seed, listen, arm) as moved:
        arm.cut()
        deadline = clock().now() + REPORT_TIME
        while clock().now() < deadline and not moved.ended:
            clock().sleep(WATCH_STEP)
        demand(
            moved.failure is not None,
            f"{moved.name} does not report a lost link: {REPORT_TIME:g} s after it was cut "
            + ("its batches ended without a word" if moved.ended else "its batches go on"),
        )
        moved.demand_standstill("its link was cut")


def places(device: Device, batches: Sequence[Batch]) -> Floats:
    """Return the positions (n, 3) [m] of the tip in the first stream that measures x, y and z; none without one."""
    for stream in device.streams:
        columns = {channel.name: column for column, channel in enumerate(stream.channels) if channel.unit == "m"}
        if set("xyz") <= columns.keys() and not stream.estimated:
            axes = [columns[axis] for axis in "xyz"]
            positions = [batch.values[:, axes] for batch in batches if batch.stream == stream.name]
            return np.concatenate(positions) if positions else np.zeros((0, 3))
    return np.zeros((0, 3))


def _motion(trajectory: Trajectory) -> tuple[Floats, Floats, Floats]:
    """Return times (n,) [s], positions (n, 3) [m] and velocities (n, 3) [m/s] of a motion."""
    time = np.arange(0.0, duration_of(trajectory), SETPOINT_STEP)
    setpoint = setpoints_at(trajectory, time)
    return time, setpoint.position, setpoint.velocity
