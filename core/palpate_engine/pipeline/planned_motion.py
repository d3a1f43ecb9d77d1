"""The motion that a pipeline plans: which it is, and whether limits and devices allow it."""

from __future__ import annotations

import numpy as np
from palpate.device import ask_devices
from palpate.errors import ConfigurationError
from palpate.trajectory import Trajectory, duration_of, setpoints_at

from palpate_engine.pipeline.approach import refuse_own_motion
from palpate_engine.pipeline.rig import Rig
from palpate_engine.safety import demand_safe

_LOOK = 5e-3  # [s] between the setpoints that devices are asked about before anything moves


def single_trajectory(rig: Rig) -> Trajectory:
    """Return the one motion of a pipeline; raises ConfigurationError if it has none or several."""
    if len(rig.trajectories) != 1:
        count = len(rig.trajectories)
        raise ConfigurationError(f"{rig.path}: a device that moves needs one [trajectory.*] table, not {count}")
    return next(iter(rig.trajectories.values()))


def check_recorded_motion(rig: Rig, trajectory: Trajectory) -> None:
    """Raise ConfigurationError where a simulated motion breaks a limit, or a device refuses it."""
    if rig.safety is not None:
        demand_safe(trajectory, rig.safety, str(rig.path))
    _check_devices_accept(rig, trajectory)


def check_live_motion(rig: Rig, trajectory: Trajectory) -> None:
    """Raise ConfigurationError where a motion of a robot has no limits or breaks one, or a device refuses it."""
    if rig.safety is None:
        raise ConfigurationError(f"{rig.path}: a live robot needs a [safety] table: workspace, speed and force limits")
    demand_safe(trajectory, rig.safety, str(rig.path))
    refuse_own_motion(rig, rig.safety)
    _check_devices_accept(rig, trajectory)


def _check_devices_accept(rig: Rig, trajectory: Trajectory) -> None:
    """Raise ConfigurationError where a device refuses the motion; nothing moves for it."""
    ask_devices(rig.devices, setpoints_at(trajectory, np.arange(0.0, duration_of(trajectory), _LOOK)))
