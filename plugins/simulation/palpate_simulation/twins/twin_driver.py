"""The driver of a twin's arm, in place of its maker's: simulated time reaches no controller of another maker."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from palpate import Floats
from palpate_arms.arm_driver import ArmDriver, ArmFaultError, ArmReading
from palpate_kit.kinematics.arm_model import ArmModel
from palpate_kit.kinematics.rotations import pose_of

from palpate_simulation.twins.direct_client import DirectCommands, DirectStates
from palpate_simulation.twins.direct_ports import DirectPorts

# Parameters of servoL, of which the twin uses none: its arm has a lag of its own. Speed [m/s], acceleration [m/s^2],
# time [s], lookahead [s], gain.
_SERVO = (0.5, 0.5, 0.002, 0.03, 1000.0)
_WATCHDOG = 10.0  # [Hz] of commands, below which the program ends (a choice)
_RUNNING, _SOUND, _PLAYING = 7, (1, 2), 2  # modes of robot, safety and program in RTDE
# Stops by the safety mode: by the maker's entry for it, and in words.
_STOP_ENTRIES = {3: "reflex", 5: "safeguard", 6: "emergency", 7: "emergency"}
_STOPS = {3: "a protective stop", 5: "a safeguard stop", 6: "an emergency stop", 7: "an emergency stop"}


class TwinDriver(ArmDriver):
    """States and commands of the twin, with the maker's own status of an arm that may move."""

    has_watchdog = True
    answers_stop = True

    def __init__(self, ports: DirectPorts, settings: Mapping[str, Any], model: ArmModel | None, tool: Floats) -> None:
        super().__init__(settings, model, tool)
        self._ports, self._last_stamp = ports, -1.0
        self._states: Any = None
        self._commands: Any = None
        self._modes = _RUNNING, _SOUND[0], _PLAYING  # of robot, safety and program

    def connect(self, observe: bool) -> None:
        """Connect to the twin in this process; without commands for one that observes."""
        self._states = DirectStates(self._ports)
        if not observe:
            self._commands = DirectCommands(self._ports)
            self._commands.setTcp(pose_of(self.tool))

    def target(self) -> Sequence[float] | None:
        """Return the target pose (6,) of the twin."""
        pose: list[float] = self._states.getTargetTCPPose()
        return pose

    def enable(self) -> None:
        """Set the watchdog."""
        self._commands.setWatchdog(_WATCHDOG)

    def read(self) -> ArmReading | None:
        """Return the newest state; None without a new one."""
        states = self._states
        stamp = states.getTimestamp()
        if stamp == self._last_stamp:
            return None
        self._last_stamp = stamp
        self._modes = states.getRobotMode(), states.getSafetyMode(), states.getRuntimeState()
        return ArmReading(
            stamp,
            states.getActualQ(),
            states.getActualQd(),
            states.getActualTCPPose(),
            states.getActualTCPSpeed(),
            states.getActualTCPForce(),
            self._status(),
        )

    def _status(self) -> tuple[float, ...]:
        """Return the maker's status of an arm that may move, or of one whose safety system stopped it."""
        status, stop_modes = dict(self.settings["sound_status"]), self.settings["stop_modes"]
        stop_entry = _STOP_ENTRIES.get(self._modes[1])
        if stop_entry is not None and stop_modes is not None and stop_modes[stop_entry]:
            status[stop_modes["channel"]] = stop_modes[stop_entry][0]
        return tuple(status.values())

    def send(self, pose: Sequence[float]) -> bool:
        """Go on to a pose (6,)."""
        return bool(self._commands.servoL(list(pose), *_SERVO))

    def keep_alive(self) -> None:
        """Feed the watchdog."""
        self._commands.kickWatchdog()

    def stop(self) -> None:
        """Stop servoing, then the program."""
        self._commands.servoStop()
        self._commands.stopScript()

    def check(self, reading: ArmReading) -> None:
        """Raise ArmFaultError by the twin's modes: for a safety stop, or a program that was stopped."""
        robot, safety, runtime = self._modes
        if safety not in _SOUND:
            raise ArmFaultError(f"the robot is in {_STOPS.get(safety, f'safety mode {safety}')}")
        if (robot, runtime) != (_RUNNING, _PLAYING):
            raise ArmFaultError("the robot's program was stopped")

    @property
    def connected(self) -> bool:
        """True if the connection of the states stands."""
        return bool(self._states.isConnected())
