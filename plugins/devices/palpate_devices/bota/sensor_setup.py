"""Setting up a SensONE: commands in ASCII, each with an acknowledgement."""

from __future__ import annotations

import contextlib
import os
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from palpate import DeviceError, clock

# Choices.
_ACKNOWLEDGE = 2.0  # [s]; a firmware that waits for silence after a command takes its time
_ATTEMPTS = 2
_CHUNK = 1 << 16  # bytes that are read at once
_MAX_KEPT = (
    8192  # bytes of what came before a chunk, in which a pattern may begin; a wrong baud rate sends endless noise
)
BAUD_RATES = (9600, 57600, 115200, 230400, 460800)  # in the order of the sensor's codes for them


def latency_timer(path: str) -> str:
    """Return how long the USB adapter waits before it passes bytes on: "1 ms" is required, 16 ms the usual default."""
    name = Path(path).resolve().name
    timer = Path("/sys/bus/usb-serial/devices") / name / "latency_timer"
    try:
        return f"{timer.read_text().strip()} ms"
    except OSError:
        return "none"


def powered_since(path: str, usb: Path = Path("/sys/class/tty")) -> str | None:
    """Return since when the USB adapter of a port is plugged in, by its host; None where that is not known."""
    # The nearest folder above the port's device that counts, in milliseconds.
    device = (usb / Path(path).resolve().name / "device").resolve()
    for folder in (device, *device.parents):
        with contextlib.suppress(OSError, ValueError):
            connected = int((folder / "power" / "connected_duration").read_text()) / 1e3
            return datetime.fromtimestamp(clock().epoch_ns() / 1e9 - connected, UTC).isoformat(timespec="seconds")
    return None


def configure(port: Any, baud: int, filters: dict[str, Any], boot: float) -> str:
    """Take a sensor at a serial `port` from its start to RUN with these filters; return its report of itself.

    The greeting that has the report may take `boot` [s].
    Opening the port has reset it. Nothing is stored in its EEPROM, whose writes are counted: after a reboot it is to
    be set up again.
    """
    # To CONFIG, interface and filters, and to RUN. Numbers of "c": temperature compensation, the sensor's calibration
    # (1: on), binary frames (0), and the code of the baud rate; of "f": length of the sinc filter, chopping (0: off),
    # the fast mode, and 1 without the FIR filter.
    greeting = _read_until(port, rb"FW version: [^\r\n]*[\r\n]", boot)
    compensation, fir = int(filters["temperature_compensation"]), int(not filters["fir"])
    _command(port, "C", "C", baud)
    _command(port, f"c,{compensation},1,0,{BAUD_RATES.index(baud)}", "c", baud)
    _command(port, f"f,{filters['sinc']},0,{int(filters['fast'])},{fir}", "f", baud)
    _command(port, "R", "R", baud)
    lines = re.findall(rb"(?:name|S/N|FW version): [ -~]*", greeting)
    return "; ".join(line.decode(errors="replace").strip() for line in lines)


def stop_stream(port: Any) -> None:
    """Leave the sensor in CONFIG, where it is quiet."""
    with contextlib.suppress(Exception):  # whatever a port that has gone raises; termios.error is not an OSError
        os.write(port.fileno(), b"C\n")


def _command(port: Any, text: str, letter: str, baud: int) -> None:
    """Send a command, again where no answer comes, and wait for its acknowledgement; raises DeviceError.

    The sensor answers ``r,0,LETTER,CODE``: code 0 is done, any other a refusal.
    """
    answer = b""
    for _ in range(_ATTEMPTS):
        port.write(text.encode() + b"\n")
        answer = _read_until(port, rb"r,0,%s,\d" % letter.encode(), _ACKNOWLEDGE)
        acknowledgement = re.search(rb"r,0,%s,(\d)" % letter.encode(), answer)
        if acknowledgement and acknowledgement[1] == b"0":
            return
        if acknowledgement:
            raise DeviceError(f"the sensor refuses the command {text!r} with code {acknowledgement[1].decode()}")
    arrived = "nothing at all" if not answer else f"{len(answer)} bytes that contain no answer"
    raise DeviceError(
        f"the sensor does not answer {text!r} within {_ATTEMPTS * _ACKNOWLEDGE:g} s: {arrived} came at {baud} baud; "
        "check power, cable and the baud rate that the sensor was set to"
    )


def _read_until(port: Any, pattern: bytes, timeout: float) -> bytes:
    """Return what arrives until a pattern has come, or until the time-out [s]; raises DeviceError."""
    data, deadline = b"", clock().now() + timeout
    while not re.search(pattern, data) and (remaining := deadline - clock().now()) > 0:
        if clock().wait([port.fileno()], remaining):
            chunk = os.read(port.fileno(), _CHUNK)
            if not chunk:
                raise DeviceError("the port was closed from the other side")
            data = data[-_MAX_KEPT:] + chunk
    return data
