"""The records of a calibration: from a robot, a simulated rig or a log; and what is checked before anything moves."""

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
from palpate_calibration.motion_segments import standing_still
from palpate_calibration.orientations import Pose, WrenchRecorder
from palpate_calibration.plan import CalibrationPlan
from palpate_calibration.settings import CalibrationSettings, Orientations, StepSettings

Seen = dict[str, dict[str, str]]  # what live devices say of themselves, by name

_LOOK = 0.2  # [s] at an arm that stands still
_STEP = 1e-3  # [s] between the instants that are checked


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


def words(reach: Reach, settings: CalibrationSettings) -> str:
    """What a motion asks, against the limits."""
    return (
        f"{1e3 * reach.low[2]:.3g} to {1e3 * reach.high[2]:.3g} mm high, at most {1e3 * reach.speed:.3g} mm/s of "
        f"{1e3 * settings.top_speed:.3g}, {reach.acceleration:.3g} m/s^2 of {settings.top_acceleration:.3g}"
    )


def reach_of(plan: CalibrationPlan, contact: bool, where: str = "[calibration] ") -> Reach:
    """What the plan's motion asks; raises ConfigurationError where it breaks a limit. Nothing moves for it."""
    trajectory = single_trajectory(plan)
    times = np.arange(0.0, duration_of(trajectory), _STEP)
    setpoint = setpoints_at(trajectory, times)
    reach = Reach.of(times, setpoint)
    keys = {"low": "deepest" if contact else "lowest", "high": "highest"}
    for excess in plan.settings.limits(contact).excesses(reach):
        key = keys.get(excess.what, f"top_{excess.what}")
        unit = {"speed": "m/s", "acceleration": "m/s^2"}.get(excess.what, "m")
        raise ConfigurationError(
            f"{where}{key}: the motion reaches {excess.value:.3g} {unit}, {excess.limit:.3g} is the limit"
        )
    if is_live(plan.devices) and plan.safety is not None:
        demand_safe(trajectory, plan.safety, f"{plan.path}: {where}".strip())
    ask_devices(plan.devices, setpoint)
    return reach


def record(plan: CalibrationPlan, seed: int = 0, seen: Seen | None = None) -> CalibrationRecord:
    """Move and record once, or read the log; raises DeviceError where a device fails, or Ctrl-C comes."""
    recorder = CalibrationRecorder(plan.alignment, plan.ports)
    _run(plan, seed, recorder.feed, seen)
    return recorder.record()


def _run(plan: CalibrationPlan, seed: int, take: Callable[[str, Batch], None], seen: Seen | None) -> None:
    seeded = replace(plan, run=plan.run.model_copy(update={"seed": plan.run.seed + seed}))
    with interruptible() as interrupt:
        flow = Flow(seeded, each(take), interrupt)
        run_flow(flow)
        if interrupt.reason is not None:
            raise KeyboardInterrupt
    if seen is not None and flow.facts is not None and flow.facts.motion is not None:
        for name, facts in flow.facts.motion.devices.items():
            seen[name] = identity_in(facts)


def one_pose(
    plan: CalibrationPlan, step: Orientations, down: tuple[float, ...], seed: int, turn: Callable[[], None]
) -> Pose:
    """Return the sensor's mean reading in one orientation; where no device turns the tool on its own, `turn` asks
    for it."""
    recorder = WrenchRecorder(plan.ports)
    sensor = plan.devices[recorder.device]
    if sensor.live:
        turn()
        _listen(plan, recorder, step.duration)
        return recorder.poses()[0]
    turned = {name: d.turned(down) if isinstance(d, Turnable) else d for name, d in plan.devices.items()}
    _run(replace(plan, devices=turned), seed, recorder.feed, None)
    return recorder.poses()[0]


def _listen(plan: CalibrationPlan, recorder: WrenchRecorder, seconds: float) -> None:
    """Read the sensor, then how the tool stands: the robot is left to the user, who turns the tool."""
    with ExitStack() as stack:
        link = stack.enter_context(plan.devices[recorder.device].connect(plan.run.seed))
        began = clock().now()
        for batch in link.batches():
            if len(batch.time):
                recorder.feed(recorder.device, batch)
            if clock().now() - began > seconds + 0.3:  # the ends are left out
                break
    arm = plan.devices[recorder.arm]
    if not recorder.reads_orientation or not isinstance(arm, Observable):
        return
    with suppress(DeviceError), arm.observe(plan.run.seed) as link:  # weight and centre of mass need no arm
        began = clock().now()
        for batch in link.batches():
            recorder.feed(recorder.arm, batch)
            if clock().now() - began > _LOOK:
                return


def poses_of_a_log(plan: CalibrationPlan, count: int) -> list[Pose]:
    """Return the standstills of a log in which the tool was turned from one orientation to the next."""
    wrench, recorder = WrenchRecorder(plan.ports), CalibrationRecorder(plan.alignment, plan.ports)

    def take(device: str, batch: Batch) -> None:
        wrench.feed(device, batch)
        recorder.feed(device, batch)

    _run(plan, 0, take, None)
    whole = recorder.record()
    still = standing_still(whole)
    if len(still) != count:
        raise LogError(
            f"calibration: the log holds {len(still)} standstills; [calibration.orientations] down names {count}"
        )
    return wrench.poses([(segment.begin, segment.end) for segment in still], whole.origin)
