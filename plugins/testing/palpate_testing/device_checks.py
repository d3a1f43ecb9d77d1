"""Checks of devices."""

from __future__ import annotations

import numpy as np
from palpate import Arm, Batch, Device, Link, Trajectory, clock

from palpate_testing.arm_checks import (
    ArmTest,
    check_follows,
    check_link_loss,
    check_obeys,
    check_retracts,
    check_stops,
    set_out,
)
from palpate_testing.failure_messages import demand

_MOST = 100  # batches of one instant of simulated time


def check_device(
    device: Device,
    trajectory: Trajectory | None = None,
    seed: int = 0,
    listen: float = 2.0,
    arm: ArmTest | None = None,
) -> None:
    """A device sends what it announces; for one that moves, give a short trajectory.

    Checked: channels known before connecting, with names that differ; batches only of announced streams, of the right
    width, with time-stamps in whole nanoseconds, one per row; `stop` twice does no harm; a device that is connected
    again with the same seed sends the same readings. A live device is listened to for some time [s], `listen`, and may
    send other readings the second time. The tip of an arm is where the motion has it, and that of a live arm goes
    outwards at first, by as much as it says, stands soon once it is stopped on its way, and goes back up once it is
    retracted: it moves. They are judged by the positions that it sends, or better by those that `arm` sees; with it the
    link to the controller is cut, too.
    """
    name = type(device).__name__
    names = [stream.name for stream in device.streams]
    demand(names, f"{name} announces no stream")
    demand(len(set(names)) == len(names), f"{name} announces two streams of one name")
    for stream in device.streams:
        channels = [channel.name for channel in stream.channels]
        demand(channels and len(set(channels)) == len(channels), f"{name}.{stream.name}: channels must have own names")
    first = batches_of(device, trajectory, seed, listen)
    demand(any(len(batch.time) for batch in first), f"{name} sends nothing")
    widths = {stream.name: len(stream.channels) for stream in device.streams}
    for batch in first:
        demand(batch.stream in widths, f"{name} sends a stream {batch.stream!r} that it does not announce")
        demand(batch.values.ndim == 2, f"{name}.{batch.stream}: values must be a table")
        demand(batch.values.shape[1] == widths[batch.stream], f"{name}.{batch.stream}: values of the wrong width")
        for stamps in (batch.time, batch.received):
            demand(stamps.dtype == np.int64, f"{name}.{batch.stream}: time-stamps must be int64 nanoseconds")
            demand(stamps.shape == (len(batch.values),), f"{name}.{batch.stream}: one time-stamp for each row")
    if trajectory is not None and moves(device, seed):
        check_follows(device, first, trajectory, is_whole=not device.live)
        if device.live:
            check_obeys(device, trajectory, seed, arm)
            check_stops(device, trajectory, seed, listen, arm)
            check_retracts(device, trajectory, seed, listen, arm)
            if arm is not None:
                check_link_loss(device, trajectory, seed, listen, arm)
    second = batches_of(device, trajectory, seed, listen)
    if device.live:
        demand(any(len(batch.time) for batch in second), f"{name} sends nothing when connected again")
        return
    same = len(first) == len(second) and all(
        a.stream == b.stream and np.array_equal(a.values, b.values, equal_nan=True)
        for a, b in zip(first, second, strict=True)
    )
    demand(same, f"{name} sends other readings when connected again with the same seed")


def moves(device: Device, seed: int) -> bool:
    """Whether a device moves the tip."""
    with device.connect(seed) as link:
        return isinstance(link, Arm)


def batches_of(device: Device, trajectory: Trajectory | None, seed: int, listen: float) -> list[Batch]:
    """What a device sends: all of it, or where it is live what comes within some time [s]."""
    with device.connect(seed) as link:
        if isinstance(link, Arm):
            demand(trajectory is not None, f"{type(device).__name__} moves: give check_device a trajectory")
            assert trajectory is not None
            if not device.live:
                link.follow(trajectory)
        found = _heard(link, listen, type(device).__name__, trajectory) if device.live else list(link.batches())
        if isinstance(link, Arm):
            link.stop()
            link.stop()
    return found


def _heard(link: Link, seconds: float, name: str, trajectory: Trajectory | None) -> list[Batch]:
    """What a live link sends within some time [s], and an arm on its motion; a silent one cannot hold it up."""
    found: list[Batch] = []
    failures: list[Exception] = []
    enough = clock().event()

    def hear() -> None:
        at_once, instant = 0, clock().now_ns()
        try:
            for batch in link.batches():
                found.append(batch)
                at_once, instant = at_once + 1 if clock().now_ns() == instant else 0, clock().now_ns()
                if clock().simulated and at_once == _MOST:
                    raise AssertionError(
                        f"{_MOST} batches came at one instant of simulated time: what does it wait by?"
                    )
                if enough.is_set():
                    return
        except Exception as error:  # whatever third-party code raises; after the end it does not matter
            if not enough.is_set():
                failures.append(error)

    thread = clock().thread(hear, name)
    thread.start()
    if isinstance(link, Arm) and trajectory is not None:
        set_out(link, trajectory)
    thread.join(seconds)
    enough.set()
    if failures:
        raise AssertionError(f"{name} raises {type(failures[0]).__name__}: {failures[0]}") from failures[0]
    return list(found)
