"""Modes and errors of a controller that franky-sim has not: a reflex, locked joints, and a recovery from them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from franky_sim import FrankaRobotServer
from franky_sim.franka_robot_protocol import (
    AutomaticErrorRecoveryCommand,
    AutomaticErrorRecoveryStatus,
    BaseCommand,
    MoveStatus,
    RobotCommand,
    RobotMode,
)

ERRORS = 41  # of the protocol


def enter_mode(server: Any, mode: str, errors: Sequence[str]) -> None:
    """End a motion as a controller does at a collision, and keep a mode and errors (their places) until a recovery."""
    error_bits = [str(place) in errors for place in range(ERRORS)]
    motion, socket = server.current_motion_id, server._tcp_socket
    normal_state = type(server).robot_state.fget

    class ServerInMode(type(server)):  # type: ignore[misc]
        @property
        def robot_state(self) -> Any:
            return normal_state(self).replace(robot_mode=RobotMode[mode], errors=error_bits, reflex_reason=error_bits)

    server.stop_motion(send_preemption_signal=False)
    server.__class__ = ServerInMode
    if motion:
        BaseCommand.send_response(socket, RobotCommand.kMove, motion, MoveStatus.kReflexAborted)
        server.reset_current_motion_id()


def _recover(command: Any, server: Any) -> None:
    """Leave the mode; franky-sim by itself answers so, but does not."""
    server.__class__ = FrankaRobotServer
    command.reply(AutomaticErrorRecoveryStatus.kSuccess)


def install_recovery() -> None:
    """Let a recovery end the mode that `enter_mode` has begun."""
    AutomaticErrorRecoveryCommand.handle = _recover
