"""The way from where an arm stands to the first setpoint, before it is gone."""

from __future__ import annotations

from palpate.device import Approaching, Link, own_motions
from palpate.errors import ConfigurationError, DeviceError
from palpate.pipeline.rig import Rig
from palpate.safety import MotionReport, SafetySettings, check_own_motion, check_setpoints
from palpate.trajectory import Trajectory


def refuse_own_motion(pipeline: Rig, limits: SafetySettings) -> None:
    """Raise ConfigurationError where what a device does by itself breaks the limits, wherever it stands."""
    lines = [
        f"  [device.{name}]: {problem}"
        for name, own in own_motions(pipeline.devices).items()
        for problem in check_own_motion(own, limits)
    ]
    if lines:
        raise ConfigurationError("\n".join([f"{pipeline.path}: an arm breaks the limits of [safety]:", *lines]))


def check_way(link: Link, trajectory: Trajectory, limits: SafetySettings) -> MotionReport | None:
    """The way to the start, which keeps the limits; None where there is none. Raises DeviceError with all it breaks."""
    if not isinstance(link, Approaching):
        return None
    times, setpoint = link.way(trajectory)
    report = check_setpoints(times, setpoint, limits)
    if report.problems:
        here, there = (", ".join(f"{1e3 * x:.1f}" for x in place) for place in setpoint.position[[0, -1]])
        lines = "\n".join(f"  {problem}" for problem in report.problems)
        raise DeviceError(
            f"the way from where the tip stands, ({here}) mm in the work frame, to the start at ({there}) mm breaks "
            f"the limits of [safety]; bring the tip nearer to the start by hand:\n{lines}"
        )
    return report
