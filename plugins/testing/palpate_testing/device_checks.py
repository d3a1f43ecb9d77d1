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

MAX_BATCHES_AT_ONCE = 100  # at one instant of simulated time (a choice): more of them would never end
MIN_STAMPS = 10  # rows, below which a rate is not judged (a choice)
MAX_RATE_ERROR = 0.05  # of the announced rate, as in the finding of a run (rate-contradicted)
MAX_EPOCH_DIFFERENCE = 10_000_000_000  # [ns] (a choice) between stamp and arrival of clocks that count from one instant
MAX_LEAD = 1.0  # [ms] that a stamp may be after its arrival, for clocks that are set by one another (a choice)


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
    _check_streams(device)
    batches = batches_of(device, trajectory, seed, listen)
    demand(any(len(batch.time) for batch in batches), f"{name} sends nothing")
    check_batches(device, batches)
    check_readings(device, batches, readings or {})
    if trajectory is not None and moves(device, seed):
        check_follows(device, batches, trajectory, is_whole=not device.live)
        if device.live:
            _check_live_arm(device, trajectory, seed, listen, arm)
    # A second connection with the same seed.
    batches_again = batches_of(device, trajectory, seed, listen)
    if device.live:
        demand(any(len(batch.time) for batch in batches_again), f"{name} sends nothing when connected again")
        return
    is_same = len(batches) == len(batches_again) and all(map(_are_equal, batches, batches_again))
    demand(is_same, f"{name} sends other readings when connected again with the same seed")


def _check_streams(device: Device) -> None:
    """Check that a device announces streams, and channels of each, whose names differ."""
    name = type(device).__name__
    names = [stream.name for stream in device.streams]
    demand(names, f"{name} announces no stream")
    demand(len(set(names)) == len(names), f"{name} announces two streams of one name")
    for stream in device.streams:
        channels = [channel.name for channel in stream.channels]
        demand(channels and len(set(channels)) == len(channels), f"{name}.{stream.name}: channels must have own names")


def _check_live_arm(device: Device, trajectory: Trajectory, seed: int, listen: float, arm: ArmTest | None) -> None:
    """Check that a live arm obeys, in the order in which a person would dare to try."""
    check_obeys(device, trajectory, seed, arm)
    check_stops(device, trajectory, seed, listen, arm)
    check_retracts(device, trajectory, seed, listen, arm)
    if arm is not None:
        check_link_loss(device, trajectory, seed, listen, arm)


def _are_equal(batch: Batch, other: Batch) -> bool:
    """Return True if two batches have the same readings of the same stream."""
    return batch.stream == other.stream and np.array_equal(batch.values, other.values, equal_nan=True)


def check_batches(device: Device, batches: Sequence[Batch]) -> None:
    """Check form and time-stamps of the batches of a device; raises AssertionError."""
    name = type(device).__name__
    streams = {stream.name: stream for stream in device.streams}
    for batch in batches:
        demand(batch.stream in streams, f"{name} sends a stream {batch.stream!r} that it does not announce")
        _check_arrays(f"{name}.{batch.stream}", batch, len(streams[batch.stream].channels))
    for stream in device.streams:
        batches_of_stream = [batch for batch in batches if batch.stream == stream.name]
        _check_stamps(f"{name}.{stream.name}", stream, batches_of_stream, device.live)


def _check_arrays(stream_name: str, batch: Batch, width: int) -> None:
    """Check types and shapes of a batch: values (n, width), finite or NaN, and two time-stamps for each row."""
    for field in ("time", "received", "values"):
        array = getattr(batch, field)
        demand(isinstance(array, np.ndarray), f"{stream_name}: {field} is a {type(array).__name__}, not an array")
    demand(batch.values.ndim == 2, f"{stream_name}: values must be a table")
    demand(batch.values.shape[1] == width, f"{stream_name}: values of the wrong width")
    for stamps in (batch.time, batch.received):
        demand(stamps.dtype == np.int64, f"{stream_name}: time-stamps must be int64 nanoseconds")
        demand(stamps.shape == (len(batch.values),), f"{stream_name}: one time-stamp for each row")
    demand(not np.isinf(batch.values).any(), f"{stream_name}: a reading is infinite; an invalid one is NaN")


def _check_stamps(stream_name: str, stream: Stream, batches: Sequence[Batch], live: bool) -> None:
    """Check that the time-stamps of a stream rise, at its rate, and are not later than their arrival.

    Readings without a clock of their own are stamped when they arrive, and several of a live device may arrive at once.
    """
    time = np.concatenate([np.zeros(0, np.int64), *(batch.time for batch in batches)])
    received = np.concatenate([np.zeros(0, np.int64), *(batch.received for batch in batches)])
    if len(time) < MIN_STAMPS:
        return
    steps = np.diff(time)
    by_arrival = live and stream.clock == "host" and np.array_equal(time, received)
    is_wrong = steps < 0 if by_arrival else steps <= 0
    demand(not is_wrong.any(), f"{stream_name}: time-stamps fall or repeat at {is_wrong.sum()} of {len(time)} rows")
    if stream.rate is not None:
        rate = 1e9 / float(np.mean(steps) if by_arrival else np.median(steps))
        is_announced = abs(rate / stream.rate - 1.0) <= MAX_RATE_ERROR
        complaint = f"{stream_name}: its time-stamps in nanoseconds have {rate:.4g} Hz, announced {stream.rate:g} Hz"
        demand(is_announced, complaint)
    lead = time - received
    # Clocks of one epoch can be compared; those of a device that counts from its start cannot.
    is_comparable = bool(np.abs(lead).max() < MAX_EPOCH_DIFFERENCE)
    largest_lead = float(lead.max()) / 1e6  # [ms]
    complaint = f"{stream_name}: a reading was measured {largest_lead:.3g} ms after it was received"
    demand(not is_comparable or largest_lead <= MAX_LEAD, complaint)


def check_readings(device: Device, batches: Sequence[Batch], readings: Mapping[str, tuple[float, float]]) -> None:
    """Check that the medians of channels are in their ranges [SI]; raises AssertionError."""
    name = type(device).__name__
    medians: dict[str, float] = {}
    for stream in device.streams:
        tables = [batch.values for batch in batches if batch.stream == stream.name]
        for column, channel in enumerate(stream.channels):
            address = ".".join(part for part in (stream.name, channel.name) if part)
            medians[address] = float(np.nanmedian(np.concatenate(tables)[:, column])) if tables else np.nan
    for address, (lowest, highest) in readings.items():
        demand(address in medians, f"{name} has no channel {address!r}")
        median = medians[address]
        demand(
            lowest <= median <= highest,
            f"{name}.{address}: the median is {median:.4g}, expected {lowest:g} to {highest:g}; is it the right "
            "column, in SI?",
        )


def moves(device: Device, seed: int) -> bool:
    """Return True if a device moves the tip."""
    with device.connect(seed) as link:
        return isinstance(link, Arm)


def batches_of(device: Device, trajectory: Trajectory | None, seed: int, listen: float) -> list[Batch]:
    """Return the batches that a device sends: all of them, or those of a live device within a time [s], `listen`."""
    with device.connect(seed) as link:
        if isinstance(link, Arm):
            demand(trajectory is not None, f"{type(device).__name__} moves: give check_device a trajectory")
            assert trajectory is not None
            if not device.live:
                link.follow(trajectory)
        if device.live:
            batches = _live_batches(link, listen, type(device).__name__, trajectory)
        else:
            batches = list(link.batches())
        # To stop twice does no harm.
        if isinstance(link, Arm):
            link.stop()
            link.stop()
    return batches


def _live_batches(link: Link, seconds: float, name: str, trajectory: Trajectory | None) -> list[Batch]:
    """Return the batches that a live link sends within some seconds, an arm's during its motion.

    They are read in a thread, so that a silent link cannot block. Raises AssertionError where the link raises.
    """
    batches: list[Batch] = []
    failures: list[Exception] = []
    is_over = clock().event()

    def read() -> None:
        """Read batches until the end."""
        count_at_once, instant = 0, clock().now_ns()
        try:
            for batch in link.batches():
                batches.append(batch)
                count_at_once = count_at_once + 1 if clock().now_ns() == instant else 0
                instant = clock().now_ns()
                if clock().simulated and count_at_once == MAX_BATCHES_AT_ONCE:
                    raise AssertionError(
                        f"{MAX_BATCHES_AT_ONCE} batches came at one instant of simulated time: what does it wait by?"
                    )
                if is_over.is_set():
                    return
        except Exception as error:  # whatever third-party code raises; after the end it does not matter
            if not is_over.is_set():
                failures.append(error)

    thread = clock().thread(read, name)
    thread.start()
    if isinstance(link, Arm) and trajectory is not None:
        set_out(link, trajectory)
    thread.join(seconds)
    is_over.set()
    if failures:
        raise AssertionError(f"{name} raises {type(failures[0]).__name__}: {failures[0]}") from failures[0]
    return list(batches)
