"""The records of a calibration: from a robot, a simulated rig or a log; and what is checked before anything moves."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace

import numpy as np

from palpate.calibration import (
    CalibrationSettings,
    Orientations,
    Pose,
    Record,
    Recorder,
    Step,
    WrenchRecorder,
    identity_in,
    resting,
)
from palpate.config import CalibrationPlan
from palpate.device import Arm, Batch
from palpate.errors import ConfigurationError, LogError
from palpate.pipeline.flow import Flow, Take, the_trajectory
from palpate.pipeline.interrupt import interruptible
from palpate.safety import demand_safe

Seen = dict[str, dict[str, str]]  # what live devices say of themselves, by name

_STEP = 1e-3  # [s] between the instants that are checked


def with_step(plan: CalibrationPlan, step: Step | Orientations) -> CalibrationPlan:
    """The plan with the devices and the motion of one step."""
    motion = {"motion": step.trajectory} if step.trajectory is not None else {}
    return replace(plan, devices=step.device or plan.devices, trajectories=motion)


def moves(plan: CalibrationPlan) -> bool:
    """Whether a device of the plan moves, so that it takes a motion; a log has had its own."""
    for device in plan.devices.values():
        if device.live:
            return True
        with device.connect(plan.run.seed) as link:
            if isinstance(link, Arm):
                return True
    return False


@dataclass(frozen=True)
class Reach:
    """What a motion asks of a robot."""

    speed: float  # [m/s]
    acceleration: float  # [m/s^2]
    low: float  # [m]
    high: float  # [m]

    def words(self, settings: CalibrationSettings) -> str:
        """Against the limits, for people."""
        return (
            f"{1e3 * self.low:.3g} to {1e3 * self.high:.3g} mm high, at most {1e3 * self.speed:.3g} mm/s of "
            f"{1e3 * settings.top_speed:.3g}, {self.acceleration:.3g} m/s^2 of {settings.top_acceleration:.3g}"
        )


def reach_of(plan: CalibrationPlan, contact: bool, where: str = "[calibration] ") -> Reach:
    """What the plan's motion asks; raises ConfigurationError where it breaks a limit. Nothing moves for it."""
    trajectory, settings = the_trajectory(plan), plan.settings
    setpoint = trajectory.at(np.arange(0.0, trajectory.total_duration, _STEP))
    heights = setpoint.position[:, 2]
    reach = Reach(
        float(np.linalg.norm(setpoint.velocity, axis=1).max()),
        float(np.linalg.norm(np.diff(setpoint.velocity, axis=0), axis=1).max()) / _STEP,
        float(heights.min()),
        float(heights.max()),
    )
    lowest = ("deepest", -settings.deepest) if contact else ("lowest", settings.lowest)
    for value, limit, key, unit in (
        (reach.speed, settings.top_speed, "top_speed", "m/s"),
        (reach.acceleration, settings.top_acceleration, "top_acceleration", "m/s^2"),
        (reach.high, settings.highest, "highest", "m"),
        (-reach.low, -lowest[1], lowest[0], "m"),
    ):
        if value > limit + 1e-12:
            sign = -1.0 if key == lowest[0] else 1.0  # heights below the skin are negative
            raise ConfigurationError(
                f"{where}{key}: the motion reaches {sign * value:.3g} {unit}, {sign * limit:.3g} is the limit"
            )
    if any(device.live for device in plan.devices.values()) and plan.safety is not None:
        demand_safe(trajectory, plan.safety, f"{plan.path}: {where}".strip())
    for device in plan.devices.values():
        device.refuse(setpoint)
    return reach


def record(plan: CalibrationPlan, seed: int = 0, seen: Seen | None = None) -> Record:
    """Move and record once, or read the log; raises DeviceError where a device fails, or Ctrl-C comes."""
    recorder = Recorder(plan.alignment, {name: device.streams for name, device in plan.devices.items()})
    _run(plan, seed, recorder.feed, seen)
    return recorder.record()


def _run(plan: CalibrationPlan, seed: int, take: Take, seen: Seen | None) -> None:
    seeded = replace(plan, run=plan.run.model_copy(update={"seed": plan.run.seed + seed}))
    with interruptible() as interrupt:
        flow = Flow(seeded, take, interrupt)
        flow.run()
        if interrupt.reason is not None:
            raise KeyboardInterrupt
    if seen is not None:
        for name, facts in flow.facts.get("devices", {}).items():
            seen[name] = identity_in(facts)


def one_pose(
    plan: CalibrationPlan, step: Orientations, down: tuple[float, ...], seed: int, turn: Callable[[], None]
) -> Pose:
    """The sensor's mean reading in one orientation; where no device turns the tool by itself, `turn` has it done."""
    streams = {name: device.streams for name, device in plan.devices.items()}
    recorder = WrenchRecorder(plan.alignment, streams)
    sensor = plan.devices[recorder.device]
    if sensor.live:
        turn()
        _listen(plan, recorder, step.duration)
        return recorder.poses()[0]
    turned = {name: device.turned(down) or device for name, device in plan.devices.items()}
    _run(replace(plan, devices=turned), seed, recorder.feed, None)
    return recorder.poses()[0]


def _listen(plan: CalibrationPlan, recorder: WrenchRecorder, seconds: float) -> None:
    """Only the sensor is connected: the robot is left to whoever turns the tool."""
    with ExitStack() as stack:
        link = stack.enter_context(plan.devices[recorder.device].connect(plan.run.seed))
        began = time.monotonic()
        for batch in link.batches():
            if len(batch.time):
                recorder.feed(recorder.device, batch)
            if time.monotonic() - began > seconds + 0.3:  # the ends are left out
                return


def poses_of_a_log(plan: CalibrationPlan, count: int) -> list[Pose]:
    """The rests of a log in which the tool was turned from one orientation to the next."""
    streams = {name: device.streams for name, device in plan.devices.items()}
    wrench, recorder = WrenchRecorder(plan.alignment, streams), Recorder(plan.alignment, streams)

    def take(device: str, batch: Batch) -> None:
        wrench.feed(device, batch)
        recorder.feed(device, batch)

    _run(plan, 0, take, None)
    whole = recorder.record()
    rests = resting(whole)
    if len(rests) != count:
        raise LogError(f"calibration: the log holds {len(rests)} rests; [calibration.orientations] down names {count}")
    return wrench.poses([(rest.begin, rest.end) for rest in rests], whole.origin)
