"""The records of a calibration, from a robot, a simulated rig or a log; and the checks before anything moves."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import replace

import numpy as np
from palpate import (
    Arm,
    Batch,
    ConfigurationError,
    DeviceError,
    LogError,
    Observable,
    Turnable,
    clock,
    duration_of,
    setpoints_at,
)
from palpate_engine import (
    Flow,
    Reach,
    ask_devices,
    demand_safe,
    each,
    interruptible,
    is_live,
    run_flow,
    single_trajectory,
)

from palpate_calibration.calibration_record import CalibrationRecord, CalibrationRecorder
from palpate_calibration.calibration_use import identity_in
from palpate_calibration.motion_segments import standstill_segments
from palpate_calibration.orientations import Pose, WrenchRecorder
from palpate_calibration.plan import CalibrationPlan
from palpate_calibration.settings import CalibrationSettings, Orientations, StepSettings

DeviceFacts = dict[str, dict[str, str]]  # identity of the live devices, by name

# Choices.
_POSE_TIME = 0.2  # [s] of states of an arm that stands still
_END_TIME = 0.3  # [s] of readings beyond a standstill, since its ends are left out
_CHECK_INTERVAL = 1e-3  # [s] between the instants of a motion that are checked


def with_step(plan: CalibrationPlan, step: StepSettings | Orientations) -> CalibrationPlan:
    """Return the plan with the devices and the motion of one step."""
    motion = {"motion": step.trajectory} if step.trajectory is not None else {}
    return replace(plan, devices=step.device or plan.devices, trajectories=motion)


def moves(plan: CalibrationPlan) -> bool:
    """Return True if a device of the plan moves, so that it takes a motion; a log contains its own."""
    for device in plan.devices.values():
        if device.live:
            return True
        with device.connect(plan.run.seed) as link:
            if isinstance(link, Arm):
                return True
    return False


def reach_text(reach: Reach, settings: CalibrationSettings) -> str:
    """Return heights, speed and acceleration of a motion in words, with their limits."""
    return (
        f"{1e3 * reach.low[2]:.3g} to {1e3 * reach.high[2]:.3g} mm high, at most {1e3 * reach.speed:.3g} mm/s of "
        f"{1e3 * settings.top_speed:.3g}, {reach.acceleration:.3g} m/s^2 of {settings.top_acceleration:.3g}"
    )


def reach_of(plan: CalibrationPlan, contact: bool, table: str = "[calibration] ") -> Reach:
    """Return how far and how fast the plan's motion goes, without moving; raises ConfigurationError beyond a limit.

    `contact` chooses the limits of a motion that presses; `table` is where the file has them, for the error's text.
    """
    trajectory = single_trajectory(plan)
    times = np.arange(0.0, duration_of(trajectory), _CHECK_INTERVAL)
    setpoint = setpoints_at(trajectory, times)
    reach = Reach.of(times, setpoint)
    keys = {"low": "deepest" if contact else "lowest", "high": "highest"}
    for excess in plan.settings.limits(contact).excesses(reach):
        key = keys.get(excess.what, f"top_{excess.what}")
        unit = {"speed": "m/s", "acceleration": "m/s^2"}.get(excess.what, "m")
        raise ConfigurationError(
            f"{table}{key}: the motion reaches {excess.value:.3g} {unit}, {excess.limit:.3g} is the limit"
        )
    if is_live(plan.devices) and plan.safety is not None:
        demand_safe(trajectory, plan.safety, f"{plan.path}: {table}".strip())
    ask_devices(plan.devices, setpoint)
    return reach


def record(plan: CalibrationPlan, seed: int = 0, device_facts: DeviceFacts | None = None) -> CalibrationRecord:
    """Move and record once, or read the log; raises DeviceError where a device fails, or Ctrl-C comes."""
    recorder = CalibrationRecorder(plan.alignment, plan.ports)
    _run(plan, seed, recorder.feed, device_facts)
    return recorder.record()


def _run(
    plan: CalibrationPlan, seed: int, take: Callable[[str, Batch], None], device_facts: DeviceFacts | None
) -> None:
    seeded = replace(plan, run=plan.run.model_copy(update={"seed": plan.run.seed + seed}))
    with interruptible() as interrupt:
        flow = Flow(seeded, each(take), interrupt)
        run_flow(flow)
        if interrupt.reason is not None:
            raise KeyboardInterrupt
    if device_facts is not None and flow.facts is not None and flow.facts.motion is not None:
        for name, facts in flow.facts.motion.devices.items():
            device_facts[name] = identity_in(facts)


def one_pose(
    plan: CalibrationPlan, step: Orientations, down: tuple[float, ...], seed: int, turn: Callable[[], None]
) -> Pose:
    """Return the sensor's mean reading in one orientation; a live rig is turned by the person whom `turn` asks.

    A simulated one turns itself, until gravity is along `down` in the sensor's frame.
    """
    recorder = WrenchRecorder(plan.ports)
    sensor = plan.devices[recorder.device]
    if sensor.live:
        turn()
        _listen(plan, recorder, step.duration)
        return recorder.poses()[0]
    devices = dict(plan.devices)
    for name, device in devices.items():
        if isinstance(device, Turnable):
            devices[name] = device.turned(down)
    _run(replace(plan, devices=devices), seed, recorder.feed, None)
    return recorder.poses()[0]


def _listen(plan: CalibrationPlan, recorder: WrenchRecorder, seconds: float) -> None:
    """Read the sensor for some seconds into a recorder, then the tool's orientation; the arm is only observed."""
    with ExitStack() as stack:
        link = stack.enter_context(plan.devices[recorder.device].connect(plan.run.seed))
        start = clock().now()
        for batch in link.batches():
            if len(batch.time):
                recorder.feed(recorder.device, batch)
            if clock().now() - start > seconds + _END_TIME:
                break
    arm = plan.devices[recorder.arm]
    if not recorder.reads_orientation or not isinstance(arm, Observable):
        return
    with suppress(DeviceError), arm.observe(plan.run.seed) as link:  # weight and centre of mass need no arm
        start = clock().now()
        for batch in link.batches():
            recorder.feed(recorder.arm, batch)
            if clock().now() - start > _POSE_TIME:
                return


def poses_of_a_log(plan: CalibrationPlan, count: int) -> list[Pose]:
    """Return the mean readings at `count` standstills of a log in which the tool was turned from one to the next."""
    wrench, recorder = WrenchRecorder(plan.ports), CalibrationRecorder(plan.alignment, plan.ports)

    def take(device: str, batch: Batch) -> None:
        wrench.feed(device, batch)
        recorder.feed(device, batch)

    _run(plan, 0, take, None)
    log_record = recorder.record()
    standstills = standstill_segments(log_record)
    if len(standstills) != count:
        raise LogError(
            f"calibration: the log holds {len(standstills)} standstills; [calibration.orientations] down names {count}"
        )
    return wrench.poses([(segment.begin, segment.end) for segment in standstills], log_record.origin)
