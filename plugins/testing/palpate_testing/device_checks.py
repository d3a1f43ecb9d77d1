"""Checks of devices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from palpate import Arm, Batch, Device, Link, Stream, Trajectory, clock

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
_MIN_STAMPS = 10  # rows, below which a rate is not judged
_RATE_ERROR = 0.05  # of the announced rate, as in the finding of a run (rate-contradicted)
_ONE_EPOCH = 10_000_000_000  # [ns] between stamp and arrival, above which the clocks count from other instants
_MAX_LEAD = 1.0  # [ms] that a stamp may be after its arrival, for clocks that are set by one another


def check_device(
    device: Device,
    trajectory: Trajectory | None = None,
    seed: int = 0,
    listen: float = 2.0,
    arm: ArmTest | None = None,
    readings: Mapping[str, tuple[float, float]] | None = None,
) -> None:
    """Check that a device sends what it announces; for one that moves, give a short trajectory.

    Checked: channels known before connecting, with names that differ; batches only of announced streams, of the right
    width, with time-stamps in whole nanoseconds, one per row, that rise at the announced rate and are not later than
    their arrival; no infinite reading; `stop` twice does no harm; a device that is connected again with the same seed
    sends the same readings. `readings` are what is known of the experiment: by channel, as in "wrench.z", the range
    [SI] of its median, which finds columns that are swapped and units that are wrong. A live device is listened to for
    some time [s], `listen`, and may send other readings the second time. The tip of an arm is where the motion has it,
    and that of a live arm goes outwards at first, by as much as it says, stands soon once it is stopped on its way, and
    goes back up once it is retracted: it moves. They are judged by the positions that it sends, or better by those that
    `arm` sees; with it the link to the controller is cut, too. Raises AssertionError with the reason.
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
    check_batches(device, first)
    check_readings(device, first, readings or {})
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


def check_batches(device: Device, batches: Sequence[Batch]) -> None:
    """Check form and time-stamps of the batches of a device; raises AssertionError."""
    name = type(device).__name__
    streams = {stream.name: stream for stream in device.streams}
    for batch in batches:
        demand(batch.stream in streams, f"{name} sends a stream {batch.stream!r} that it does not announce")
        what = f"{name}.{batch.stream}"
        for field in ("time", "received", "values"):
            is_array = isinstance(getattr(batch, field), np.ndarray)
            demand(is_array, f"{what}: {field} is a {type(getattr(batch, field)).__name__}, not an array")
        demand(batch.values.ndim == 2, f"{what}: values must be a table")
        demand(batch.values.shape[1] == len(streams[batch.stream].channels), f"{what}: values of the wrong width")
        for stamps in (batch.time, batch.received):
            demand(stamps.dtype == np.int64, f"{what}: time-stamps must be int64 nanoseconds")
            demand(stamps.shape == (len(batch.values),), f"{what}: one time-stamp for each row")
        demand(not np.isinf(batch.values).any(), f"{what}: a reading is infinite; an invalid one is NaN")
    for stream in device.streams:
        sent = [batch for batch in batches if batch.stream == stream.name]
        _check_stamps(f"{name}.{stream.name}", stream, sent, device.live)


def _check_stamps(what: str, stream: Stream, batches: Sequence[Batch], live: bool) -> None:
    """Check that the time-stamps of a stream rise, at its rate, and are not later than their arrival.

    Readings without a clock of their own are stamped when they arrive, and several of a live device may arrive at once.
    """
    time = np.concatenate([np.zeros(0, np.int64), *(batch.time for batch in batches)])
    received = np.concatenate([np.zeros(0, np.int64), *(batch.received for batch in batches)])
    if len(time) < _MIN_STAMPS:
        return
    steps = np.diff(time)
    by_arrival = live and stream.clock == "host" and np.array_equal(time, received)
    is_wrong = steps < 0 if by_arrival else steps <= 0
    demand(not is_wrong.any(), f"{what}: time-stamps fall or repeat at {int(is_wrong.sum())} of {len(time)} rows")
    if stream.rate is not None:
        rate = 1e9 / float(np.mean(steps) if by_arrival else np.median(steps))
        is_announced = abs(rate / stream.rate - 1.0) <= _RATE_ERROR
        demand(is_announced, f"{what}: its time-stamps in nanoseconds have {rate:.4g} Hz, announced {stream.rate:g} Hz")
    lead = time - received
    # Clocks of one epoch can be compared; those of a device that counts from its start cannot.
    is_comparable = bool(np.abs(lead).max() < _ONE_EPOCH)
    late = float(lead.max()) / 1e6
    demand(
        not is_comparable or late <= _MAX_LEAD, f"{what}: a reading was measured {late:.3g} ms after it was received"
    )


def check_readings(device: Device, batches: Sequence[Batch], readings: Mapping[str, tuple[float, float]]) -> None:
    """Check that the medians of channels are in their ranges [SI]; raises AssertionError."""
    name = type(device).__name__
    medians: dict[str, float] = {}
    for stream in device.streams:
        values = [batch.values for batch in batches if batch.stream == stream.name]
        for column, channel in enumerate(stream.channels):
            address = ".".join(part for part in (stream.name, channel.name) if part)
            medians[address] = float(np.nanmedian(np.concatenate(values)[:, column])) if values else np.nan
    for address, (lowest, highest) in readings.items():
        demand(address in medians, f"{name} has no channel {address!r}")
        value = medians[address]
        demand(
            lowest <= value <= highest,
            f"{name}.{address}: the median is {value:.4g}, expected {lowest:g} to {highest:g}; is it the right column, "
            "in SI?",
        )


def moves(device: Device, seed: int) -> bool:
    """Return True if a device moves the tip."""
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
