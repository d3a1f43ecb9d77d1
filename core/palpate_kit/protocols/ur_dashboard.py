"""Questions to a controller's ports before the client library is let near them: it hangs where they do not answer."""

from __future__ import annotations

import re
import socket
from collections.abc import Callable, Mapping

from palpate import DeviceError

RTDE, SCRIPT, DASHBOARD = 30004, 30003, 29999  # ports of a controller (Universal Robots, "Remote control via TCP/IP")
_TIMEOUT = 1.0  # [s] for an answer: a choice
_VERSION_2 = b"\x00\x05\x56\x00\x02"  # request: length 5, "V", protocol version 2 (RTDE guide)
_ANSWER_LENGTH = 4  # bytes of its answer: length, "V", accepted
_PAYLOAD_SINCE = (5, 6)  # version of PolyScope whose states have the payload


def reports_payload(facts: Mapping[str, str]) -> bool:
    """Return True if the controller's software can report the payload: from 5.6 on."""
    match = re.search(r"(\d+)\.(\d+)", facts.get("software", ""))
    return match is not None and (int(match[1]), int(match[2])) >= _PAYLOAD_SINCE


def reported_model(facts: Mapping[str, str]) -> str:
    """Return the name of the arm that the dashboard gives: "UR3" is a UR3e, where the software is of an e-Series."""
    return facts.get("robot", "").lower().rstrip("e") + "e"


def probe(host: str) -> dict[str, str]:
    """Return the controller's facts; raises DeviceError where one of its ports does not answer as it should."""
    _ask(host, RTDE, "RTDE", lambda link: _check_rtde(link, host))
    facts = _ask(host, DASHBOARD, "dashboard", _dashboard_answers)
    _ask(host, SCRIPT, "script", lambda link: {})
    return facts


def _ask(host: str, port: int, name: str, talk: Callable[[socket.socket], dict[str, str]]) -> dict[str, str]:
    """Return what a talk at a port of the controller learns; raises DeviceError where the port does not answer."""
    try:
        with socket.create_connection((host, port), timeout=_TIMEOUT) as link:
            return talk(link)
    except TimeoutError as error:
        raise DeviceError(f"{host}: the {name} port {port} does not answer within {_TIMEOUT:g} s") from error
    except OSError as error:
        reason = error.strerror or str(error)
        raise DeviceError(
            f"{host}: the {name} port {port} cannot be reached ({reason}); is the robot on, and is the address right?"
        ) from error


def _check_rtde(link: socket.socket, host: str) -> dict[str, str]:
    """Raise DeviceError where the controller does not speak version 2 of RTDE; it has no facts."""
    link.sendall(_VERSION_2)
    if _read(link, _ANSWER_LENGTH)[2:] != b"V\x01":
        raise DeviceError(f"{host}: the controller does not speak RTDE version 2")
    return {}


def _dashboard_answers(link: socket.socket) -> dict[str, str]:
    """Return the facts that the controller states on an open connection."""
    lines = link.makefile("rw", encoding="utf-8", newline="\n")
    lines.readline()

    def answer(question: str) -> str:
        lines.write(question + "\n")
        lines.flush()
        return lines.readline()

    return dashboard_facts(answer)


def dashboard_facts(answer: Callable[[str], str]) -> dict[str, str]:
    """Return the facts of a controller whose dashboard answers questions."""
    questions = {
        "software": "PolyscopeVersion",
        "robot": "get robot model",
        "serial": "get serial number",
        "remote": "is in remote control",
        "robot_mode": "robotmode",
        "safety": "safetystatus",
    }
    answers = {fact: answer(question).strip() for fact, question in questions.items()}
    return {
        fact: text.partition(": ")[2] if fact in ("robot_mode", "safety") else text for fact, text in answers.items()
    }


def refuse_unready(facts: Mapping[str, str], host: str, by_hand: bool = False) -> None:
    """Raise DeviceError where a robot with these facts cannot be moved, by a program or by hand."""
    if facts["remote"] == "false" and not by_hand:
        raise DeviceError(f"{host}: the robot is not in remote control; switch it on the pendant")
    if facts["robot_mode"] not in ("", "RUNNING", *(("BACKDRIVE",) if by_hand else ())):
        raise DeviceError(
            f"{host}: the robot is {facts['robot_mode']}, not RUNNING; power it on and release its brakes"
        )
    if facts["safety"] and facts["safety"] not in ("NORMAL", "REDUCED"):
        raise DeviceError(f"{host}: the robot's safety status is {facts['safety']}; clear it on the pendant")


def _read(link: socket.socket, count: int) -> bytes:
    """Return so many bytes from a connection; raises ConnectionResetError where it ends before."""
    data = b""
    while len(data) < count:
        chunk = link.recv(count - len(data))
        if not chunk:
            raise ConnectionResetError("connection closed")
        data += chunk
    return data
