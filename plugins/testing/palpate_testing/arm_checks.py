"""Checks of arms: whether the tip goes where the motion has it, and whether it stands once it is stopped."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from functools import partial

import numpy as np
from palpate import (
    Arm,
    ArmLimits,
    Batch,
    Device,
    DeviceError,
    Floats,
    Link,
    SupportsLimits,
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


def set_out(link: Arm, trajectory: Trajectory) -> None:
    """Let an arm that is listened to follow a motion, as a run does: once it has said where it stands.

    One that keeps limits by itself gets those of the motion, with room for the way to its start.
    """
    clock().sleep(_FIRST)
    if isinstance(link, SupportsLimits):
        time, place, speed = _motion(trajectory)
        sudden = np.linalg.norm(np.diff(speed, axis=0), axis=1).max(initial=0.0) / float(time[1] - time[0])
        low, high = (tuple((side - _ROOM * sign).tolist()) for side, sign in ((place.min(0), 1), (place.max(0), -1)))
        fastest = float(np.linalg.norm(speed, axis=1).max())
        link.limit(ArmLimits(low, high, 1.1 * fastest, 1.1 * float(sudden), 0.1, 0.2), lambda reason: None)
    link.follow(trajectory)


def check_follows(device: Device, batches: Sequence[Batch], trajectory: Trajectory, is_whole: bool) -> None:
    """The tip has gone to the farthest place of a motion, or, where it was not listened to the end, towards it."""
    name, seen = type(device).__name__, places(device, batches)
    demand(len(seen), f"{name} moves, and sends no position of its tip")
    _, place, _ = _motion(trajectory)
    apart = np.linalg.norm(seen[:, None] - place[None, :: max(len(place) // 200, 1)], axis=2).min(axis=0)
    share = float((apart < _AWAY).mean())
    least = 0.95 if is_whole else 0.05
    demand(share >= least, f"{name} does not follow: its tip came to {share:.0%} of the places of the motion")


def check_stops(device: Device, trajectory: Trajectory, seed: int, listen: float) -> None:
    """An arm that is stopped on its way stands soon, as its own positions say."""
    name = type(device).__name__
    _, place, _ = _motion(trajectory)
    farthest = float(np.linalg.norm(place - place[0], axis=1).max())
    heard: list[Batch] = []
    with device.connect(seed) as link:
        assert isinstance(link, Arm)
        hearing = clock().thread(partial(_hear, link, heard), f"{name} is stopped")
        hearing.start()
        set_out(link, trajectory)
        deadline = clock().now() + listen
        while clock().now() < deadline:
            seen = places(device, list(heard))
            if len(seen) and np.linalg.norm(seen - place[0], axis=1).min() < _AWAY:
                begun = seen[int(np.linalg.norm(seen - place[0], axis=1).argmin()) :]
                if np.linalg.norm(begun[-1] - place[0]) > _BEGUN * farthest:
                    break
            clock().sleep(0.01)
        else:
            raise AssertionError(f"{name} has not begun the motion within {listen:g} s")
        link.stop()
        clock().sleep(_REACTS)
        before = len(heard)
        clock().sleep(_LOOKS)
        rest = places(device, list(heard)[before:])
        moved = float(np.ptp(rest, axis=0).max()) if len(rest) else 0.0
    demand(
        moved < _STANDS,
        f"{name} does not obey: {_REACTS:g} s after `stop` its tip still moves by {1e3 * moved:.1f} mm in {_LOOKS:g} s",
    )


def _hear(link: Link, heard: list[Batch]) -> None:
    with suppress(DeviceError):  # an arm that was stopped may say so
        for batch in link.batches():
            heard.append(batch)


def places(device: Device, batches: Sequence[Batch]) -> Floats:
    """Positions (n, 3) [m] of the tip, of the first stream that measures x, y and z; none where there is none."""
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
