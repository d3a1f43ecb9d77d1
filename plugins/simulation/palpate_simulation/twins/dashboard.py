"""Answers of a controller's dashboard."""

from __future__ import annotations

from collections.abc import Mapping

# Modes by their numbers in RTDE (UR, "Real-Time Data Exchange guide").
ROBOT_MODES = {3: "POWER_OFF", 4: "POWER_ON", 5: "IDLE", 6: "BACKDRIVE", 7: "RUNNING"}
SAFETY_MODES = {2: "REDUCED", 3: "PROTECTIVE_STOP", 5: "SAFEGUARD_STOP", 7: "ROBOT_EMERGENCY_STOP"}
PROGRAM_STATES = {2: "PLAYING", 4: "PAUSED"}
TOO_SOON = (
    "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop before unlocking"
)


def dashboard_facts(modes: tuple[int, int, int], version: str, model: str, remote: bool) -> Mapping[str, str]:
    """Return the answers to questions, by question; `modes` are those of robot, safety and program in RTDE."""
    robot, safety, runtime = modes
    safety_mode = SAFETY_MODES.get(safety, "NORMAL")
    program_state = PROGRAM_STATES.get(runtime, "STOPPED")
    return {
        "PolyscopeVersion": f"URSoftware {version} (software)",
        "get serial number": "20233500001",  # a choice: of the form of a UR's
        "get robot model": model.upper().rstrip("E"),
        "is in remote control": str(remote).lower(),
        "robotmode": f"Robotmode: {ROBOT_MODES.get(robot, 'NO_CONTROLLER')}",
        "safetymode": f"Safetymode: {safety_mode}",
        "safetystatus": f"Safetystatus: {safety_mode}",
        "running": f"Program running: {str(program_state == 'PLAYING').lower()}",
        "programState": f"{program_state} rtde_control",
        "close safety popup": "closing safety popup",
        "quit": "Disconnected",
    }
