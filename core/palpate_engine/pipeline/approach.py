"""The way from where an arm stands to the first setpoint, before the arm goes it."""

from __future__ import annotations

from collections.abc import Iterable

from palpate.device import Arm, Link, SupportsApproach, SupportsForceControl, own_motions
from palpate.errors import ConfigurationError, DeviceError
from palpate.trajectory import ForceControlled, Trajectory, surface_of

from palpate_engine.pipeline.rig import Rig
from palpate_engine.safety import MotionReport, SafetySettings, check_own_motion, check_setpoints


def refuse_own_motion(pipeline: Rig, limits: SafetySettings) -> None:
    """Raise ConfigurationError where what a device does by itself breaks the limits, wherever it stands."""
    lines = [
        f"  [device.{name}]: {problem}"
        for name, motion in own_motions(pipeline.devices).items()
        for problem in check_own_motion(motion, limits)
    ]
    if lines:
        raise ConfigurationError("\n".join([f"{pipeline.path}: an arm breaks the limits of [safety]:", *lines]))


def check_approach(link: Link, trajectory: Trajectory, limits: SafetySettings) -> MotionReport | None:
    """Return the way to the start, which keeps the limits; None if not needed. Raises DeviceError with all it
    breaks."""
    if not isinstance(link, SupportsApproach):
        return None
    times, setpoint = link.approach_path(trajectory)
    report = check_setpoints(times, setpoint, limits, surface_of(trajectory))
    if report.problems:
        place, start = (", ".join(f"{1e3 * x:.1f}" for x in point) for point in setpoint.position[[0, -1]])
        lines = "\n".join(f"  {problem}" for problem in report.problems)
        raise DeviceError(
            f"the way from where the tip stands, ({place}) mm in the work frame, to the start at ({start}) mm breaks "
            f"the limits of [safety]; bring the tip nearer to the start by hand:\n{lines}"
        )
    return report


def check_start(arms: Iterable[Arm], trajectory: Trajectory, limits: SafetySettings) -> None:
    """Raise DeviceError where the way of an arm to the start breaks a limit."""
    for arm in arms:
        check_force_control(arm, trajectory)
        check_approach(arm, trajectory, limits)


def check_force_control(arm: Arm, trajectory: Trajectory) -> None:
    """Raise ConfigurationError where a force leads the motion, and the arm cannot be led so."""
    if isinstance(trajectory, ForceControlled):
        if not isinstance(arm, SupportsForceControl):
            raise ConfigurationError(f"a force leads this motion, and {type(arm).__name__} cannot be led by one")
        arm.refuse_law(trajectory.force_law)
