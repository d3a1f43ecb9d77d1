"""Run a calibration, from the first batch to the values."""

from __future__ import annotations

import importlib.metadata
import platform
from collections.abc import Callable
from contextlib import ExitStack
from datetime import UTC, datetime
from typing import Any

import numpy as np

from palpate.calibration import (
    CalibratedValue,
    Calibration,
    CalibrationSettings,
    Record,
    Recorder,
    Session,
    calibrate,
    identity_of,
)
from palpate.config import CalibrationPlan, plain_settings
from palpate.device import Arm
from palpate.errors import ConfigurationError
from palpate.pipeline.flow import merged
from palpate.trajectory import Trajectory

Say = Callable[[str], None]


def run_calibration(plan: CalibrationPlan, say: Say = lambda text: None) -> tuple[Calibration, Session, list[Record]]:
    """Move and record as often as the plan says, and evaluate.

    Raises ConfigurationError where the motion breaks a limit, LogError where a record cannot be used.
    """
    first, moved = _record(plan, 0, say)
    # A recorded log has had all its repeats.
    later = range(1, plan.settings.repeats) if moved else range(0)
    records = [first, *(_record(plan, repeat, say)[0] for repeat in later)]
    say("evaluating")
    session = calibrate(records, plan.settings)
    return _calibration(plan, session), session, records


def _record(plan: CalibrationPlan, repeat: int, say: Say) -> tuple[Record, bool]:
    """One repeat, and whether a device moved for it."""
    recorder = Recorder(plan.alignment, {name: device.streams for name, device in plan.devices.items()})
    with ExitStack() as stack:
        seed = plan.run.seed + repeat
        links = {name: stack.enter_context(device.connect(seed)) for name, device in plan.devices.items()}
        arms = [link for link in links.values() if isinstance(link, Arm)]
        if arms:
            trajectory = _trajectory(plan)
            refuse_beyond_limits(trajectory, plan.settings)
            say(f"repeat {repeat + 1} of {plan.settings.repeats}: {trajectory.total_duration:.0f} s of motion in air")
            for arm in arms:
                stack.callback(arm.stop)
                arm.follow(trajectory)
        else:
            say("reading the log")
        for name, batch in merged(links):
            recorder.feed(name, batch)
    return recorder.record(), bool(arms)


def _trajectory(plan: CalibrationPlan) -> Trajectory:
    if plan.settings.trajectory is not None:
        return plan.settings.trajectory
    if len(plan.trajectories) != 1:
        raise ConfigurationError(
            f'{plan.path}: a calibration needs one motion: [calibration] trajectory = {{ type = "shake" }}'
        )
    return next(iter(plan.trajectories.values()))


def refuse_beyond_limits(trajectory: Trajectory, settings: CalibrationSettings) -> None:
    """Raise ConfigurationError where a motion is too fast, too sudden, too low or too high anywhere."""
    step = 1e-3
    setpoint = trajectory.at(np.arange(0.0, trajectory.total_duration, step))
    speed = float(np.linalg.norm(setpoint.velocity, axis=1).max())
    sudden = float(np.linalg.norm(np.diff(setpoint.velocity, axis=0), axis=1).max()) / step
    heights = setpoint.position[:, 2]
    for value, limit, key, unit in (
        (speed, settings.top_speed, "top_speed", "m/s"),
        (sudden, settings.top_acceleration, "top_acceleration", "m/s^2"),
        (float(heights.max()), settings.highest, "highest", "m"),
        (-float(heights.min()), -settings.lowest, "lowest", "m"),
    ):
        if value > limit:
            raise ConfigurationError(
                f"[calibration] {key}: the motion reaches {abs(value):.3g} {unit}, {abs(limit):.3g} is the limit"
            )


def _shake(session: Session) -> dict[str, Any]:
    if not session.shakes:
        return {}
    first = session.shakes[0]
    return {
        "frequencies": list(first.frequencies),
        "amplitudes": list(first.amplitudes),
        "residual": session.residual,
        "count": len(session.shakes),
    }


def _calibration(plan: CalibrationPlan, session: Session) -> Calibration:
    roles = ("force", "position", "velocity")
    channels = {role: s.channel for role in roles if (s := getattr(plan.alignment, role)) is not None}
    devices = identity_of(plan.devices, channels)
    for name in devices:
        devices[name]["type"] = plan.registry.name_of(type(plan.devices[name]))
    tip: dict[str, Any] | None = None
    if len(plan.indenters) == 1:
        tip = plain_settings(next(iter(plan.indenters.values())), plan.registry)
    return Calibration(
        name=plan.run.name,
        created=datetime.now(UTC).replace(microsecond=0),
        values={name: CalibratedValue.of(measured) for name, measured in session.values.items()},
        channels=channels,
        devices=devices,
        tip=tip,
        shake=_shake(session),
        notes=session.notes,
        versions={"palpate": importlib.metadata.version("palpate"), "python": platform.python_version()},
    )
