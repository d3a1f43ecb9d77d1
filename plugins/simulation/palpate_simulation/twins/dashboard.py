"""What a controller's dashboard answers."""

from __future__ import annotations

from collections.abc import Mapping

_ROBOT_MODES = {3: "POWER_OFF", 4: "POWER_ON", 5: "IDLE", 6: "BACKDRIVE", 7: "RUNNING"}
_SAFETY = {2: "REDUCED", 3: "PROTECTIVE_STOP", 5: "SAFEGUARD_STOP", 7: "ROBOT_EMERGENCY_STOP"}
_PROGRAM = {2: "PLAYING", 4: "PAUSED"}
TOO_SOON = (
    "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop before unlocking"
)


def dashboard_facts(modes: tuple[int, int, int], version: str, model: str, remote: bool) -> Mapping[str, str]:
    """Answers that are facts, by question; modes of robot, safety and program as RTDE numbers them."""
    robot, safety, runtime = modes
    state = _SAFETY.get(safety, "NORMAL")
    return {
        "PolyscopeVersion": f"URSoftware {version} (software)",
        "get serial number": "20233500001",
        "get robot model": model.upper().rstrip("E"),
        "is in remote control": str(remote).lower(),
        "robotmode": f"Robotmode: {_ROBOT_MODES.get(robot, 'NO_CONTROLLER')}",
        "safetymode": f"Safetymode: {state}",
        "safetystatus": f"Safetystatus: {state}",
        "running": f"Program running: {str(_PROGRAM.get(runtime) == 'PLAYING').lower()}",
        "programState": f"{_PROGRAM.get(runtime, 'STOPPED')} rtde_control",
        "close safety popup": "closing safety popup",
        "quit": "Disconnected",
    }
