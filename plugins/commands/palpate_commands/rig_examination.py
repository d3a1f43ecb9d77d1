"""The examination of a live rig, without moving it: the findings of `palpate doctor`."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from palpate import Batch, Device, DeviceError, Floats, Link, Observable, ReportsHealth, Stream, SupportsLimits, clock
from palpate_engine import (
    Guard,
    LiveLinks,
    Pipeline,
    SafetySettings,
    check_approach,
    check_motion,
    check_own_motion,
    declared_noise,
    own_motions,
    payloads,
)

# Choices.
_RATE_TOLERANCE = 0.02  # of the nominal rate
_MAX_LATENESS = 0.01  # [s] of all readings but 1 %
_LATE_QUANTILE = 0.99
_MIN_INTERVALS = 10  # between readings, for a rate
_MIN_CORES = 2  # of the host
_BUSY_CORES = 1.2  # that a run keeps busy


@dataclass(frozen=True)
class Finding:
    """One finding, with its verdict."""

    verdict: Literal["good", "note", "bad"]
    subject: str
    text: str


def examine(pipeline: Pipeline, duration: float) -> Iterator[Finding]:
    """Yield the findings on every live device, listened to for a while [s]; nothing is commanded to move."""
    if any(device.live for device in pipeline.devices.values()):  # else no arm could move
        yield from _motion(pipeline)
        yield _host()
    with ExitStack() as stack:
        links: dict[str, Link] = {}
        for name, device in pipeline.devices.items():
            if not device.live:
                yield Finding("note", name, "is not live: nothing to examine")
                continue
            try:
                links[name] = stack.enter_context(_connection(device, pipeline.run.seed))
                yield Finding("good", name, "is connected")
            except DeviceError as error:
                yield Finding("bad", name, str(error))
        if links:
            yield from _listen(pipeline, links, duration)


def _host() -> Finding:
    """Return the finding on this computer: its cores, and the load of other programs."""
    cores, load = len(os.sched_getaffinity(0)), os.getloadavg()[0]
    text = f"{cores} core{'s' if cores > 1 else ''} for this program, a load of {load:.1f} in the last minute"
    if cores < _MIN_CORES:
        return Finding("note", "host", f"{text}: too small, robot and sensor have to share with estimates and page")
    if load > cores - _BUSY_CORES:
        return Finding("note", "host", f"{text}: other programs leave too little, estimates and page will be late")
    return Finding("good", "host", text)


def _connection(device: Device, seed: int) -> AbstractContextManager[Link]:
    """Return the connection to a device; an arm is only observed, so that a program that runs on it goes on."""
    return device.observe(seed) if isinstance(device, Observable) else device.connect(seed)


def _motion(pipeline: Pipeline) -> Iterator[Finding]:
    """Yield the findings on the motions of a pipeline, by computation."""
    for name, trajectory in pipeline.trajectories.items():
        if pipeline.safety is None:
            yield Finding("bad", f"trajectory {name}", "no [safety] table to check it against")
            continue
        yield from _own_motions(pipeline, pipeline.safety)
        report = check_motion(trajectory, pipeline.safety)
        yield from (Finding("bad", f"trajectory {name}", problem) for problem in report.problems)
        if not report.problems:
            forces = f"{report.peak_force:.1f} N by computation, and {report.unfelt_force:.1f} N by its depth alone"
            text = f"keeps the limits; at most {forces}"
            yield Finding("good", f"trajectory {name}", text)


def _own_motions(pipeline: Pipeline, limits: SafetySettings) -> Iterator[Finding]:
    for name, motion in own_motions(pipeline.devices).items():
        yield from (Finding("bad", name, problem) for problem in check_own_motion(motion, limits))


def _ways(pipeline: Pipeline, links: Mapping[str, Link]) -> Iterator[Finding]:
    """Yield the findings on the ways of the arms to the start of each motion, from where they stand now."""
    for name, trajectory in pipeline.trajectories.items():
        for arm, link in links.items():
            if pipeline.safety is None:
                continue
            if isinstance(link, SupportsLimits):
                link.limit(pipeline.safety.of_an_arm, lambda _: None)  # nothing moves that could be stopped
            try:
                report = check_approach(link, trajectory, pipeline.safety)
            except DeviceError as error:
                yield Finding("bad", arm, str(error))
                continue
            if report is not None:
                length = 1e3 * float(np.linalg.norm(report.high - report.low))  # [mm] the diagonal of its box
                text = f"the way to the start of {name}, {length:.1f} mm in {report.duration:.1f} s, keeps the limits"
                yield Finding("good", arm, text)


def _listen(pipeline: Pipeline, links: Mapping[str, Link], duration: float) -> Iterator[Finding]:
    """Yield the findings on the readings of a while [s]: rates, standstill, ways to the start, health, calibration."""
    streams = pipeline.ports.streams
    guard = Guard(pipeline.safety, pipeline.ports)
    batches = _readings(links, LiveLinks(links, pipeline.devices, guard), duration)
    if guard.reason is not None:
        yield Finding("bad", "link", guard.reason)
        return
    for name in links:
        for stream in streams[name]:
            stream_batches = batches.get((name, stream.name), [])
            yield from _stream(f"{name}.{stream.name}", stream, stream_batches, pipeline.alignment.gap)
    # Force and velocity at rest need every device.
    if len(links) == len(pipeline.devices):
        yield _standstill(guard, declared_noise(pipeline))
    yield from _ways(pipeline, links)
    health = {name: link.health for name, link in links.items() if isinstance(link, ReportsHealth)}
    yield from _health(pipeline, health)


def _readings(links: Mapping[str, Link], live: LiveLinks, duration: float) -> dict[tuple[str, str], list[Batch]]:
    """Return the batches that arrive in a while [s], by device and stream."""
    batches: dict[tuple[str, str], list[Batch]] = {}
    live.start()
    try:
        for arrivals in live.until(clock().now() + duration):
            for name, batch in arrivals:
                batches.setdefault((name, batch.stream), []).append(batch)
    finally:
        live.stop()
    return batches


def _health(pipeline: Pipeline, health: Mapping[str, Mapping[str, Any]]) -> Iterator[Finding]:
    """Yield the findings on the reports of devices: their health, their payloads, and whether the calibration holds."""
    for name, report in health.items():
        yield from (Finding("good", name, line) for line in _health_lines(report))
        yield from (Finding("note", name, text) for text in payloads(pipeline.alignment, {name: report}))
    if pipeline.calibration is not None:
        for flag in pipeline.calibration.flags(pipeline, health):
            yield Finding("note", "calibration", flag.message)


def _stream(name: str, stream: Stream, batches: list[Batch], gap: float) -> Iterator[Finding]:
    """Yield the findings on a stream: rate, pauses above a `gap` [s], lateness, invalid readings."""
    if not batches:
        yield Finding("bad", name, "sends nothing")
        return
    stamps = np.concatenate([batch.time for batch in batches])  # (n,) [ns]
    received = np.concatenate([batch.received for batch in batches])  # (n,) [ns]
    intervals = np.diff(stamps) / 1e9  # [s]
    if len(intervals) < _MIN_INTERVALS:
        yield Finding("bad", name, f"sent only {len(stamps)} readings")
        return
    # The mean rate, compared with the nominal one, and the longest pause.
    rate, longest = 1.0 / float(intervals.mean()), float(intervals.max())
    is_nominal = stream.rate is None or abs(rate / stream.rate - 1.0) < _RATE_TOLERANCE
    remark = "" if is_nominal else f" (nominally {stream.rate:g} Hz)"
    text = f"{rate:.1f} Hz{remark}, longest pause {1e3 * longest:.1f} ms"
    yield Finding("good" if is_nominal else "note", name, text)
    if longest > gap:
        yield Finding("bad", name, f"a pause of {1e3 * longest:.0f} ms is a gap for [alignment] gap = {1e3 * gap:g} ms")
    yield from _lateness(name, (received - stamps) / 1e9)
    invalid = sum(int(np.count_nonzero(~batch.valid)) for batch in batches)
    if invalid:
        yield Finding("bad", name, f"{invalid} of {len(stamps)} readings are invalid")


def _lateness(name: str, lateness: Floats) -> Iterator[Finding]:
    """Yield a note on readings that arrive late, by their lateness (n,) [s]."""
    median, p99 = float(np.median(lateness)), float(np.quantile(lateness, _LATE_QUANTILE))
    if p99 > _MAX_LATENESS:
        text = f"arrives late: {1e3 * median:.2f} ms, 1 % later than {1e3 * p99:.1f} ms; is its latency timer at 1 ms?"
        yield Finding("note", name, text)


def _standstill(guard: Guard, declared: Mapping[str, tuple[float, float]]) -> Finding:
    try:
        standstill = guard.judge_standstill(declared)
    except DeviceError as error:
        return Finding("bad", "standstill", str(error))
    text = f"force {standstill.force:.3f} N, noise {standstill.force_std:.4f} N"
    if standstill.velocity_std is not None:
        text += f"; noise of the velocity {1e3 * standstill.velocity_std:.3f} mm/s"
    return Finding("good", "standstill", text)


def _health_lines(health: Mapping[str, Any]) -> Iterator[str]:
    for key, value in health.items():
        if not isinstance(value, Mapping) and key != "say":
            yield f"{key.replace('_', ' ')}: {value:.3g}" if isinstance(value, float) else f"{key}: {value}"
