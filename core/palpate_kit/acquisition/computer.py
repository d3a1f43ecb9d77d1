"""The computer that a device's process runs on: processes, serial ports, robots, networks.

Devices reach all of these through `host()`, so that a simulation can put software in their place.
"""

from __future__ import annotations

import contextlib
import gc
import os
import resource
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, Protocol

from palpate import DeviceError

from palpate_kit.acquisition.device_lock import network_device, reserve

_SPELL = 3_000_000  # [us] of computing at real-time priority without a pause (0243)
_GRACE = 1_000_000  # [us] more, after which the system kills the process
_SECOND = 1e9  # [ns]
_STATE_RATE = 500.0  # [Hz] of the states of an e-Series arm, the highest of its protocol


@dataclass(frozen=True)
class Activity:
    """State of a process at a moment, by the letter that the system has for it (proc(5)), and its processor time."""

    state: str  # "R" computes, or waits for a core; "S" sleeps; "D" waits for a disk; "T" was stopped
    processor_time: float  # [s]


class Process(Protocol):
    """A process that was started, as `subprocess.Popen`."""

    returncode: int | None

    @property
    def pid(self) -> int:
        """Its number."""
        ...

    def poll(self) -> int | None:
        """Its exit code; None while it runs."""
        ...

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end for up to `timeout` [s]; raises subprocess.TimeoutExpired."""
        ...

    def kill(self) -> None:
        """End it without asking it."""


class Host(Protocol):
    """Services of the computer that devices need."""

    def start(self, role: str, module: str, descriptors: Sequence[int], settings: str) -> Process:
        """Run a module as a process of its own, for a "robot" or a "sensor"; arguments: open files, settings (JSON)."""
        ...

    def activity(self, process: Process) -> Activity | None:
        """Return what a process that was started does now; None where it has gone, or the system does not say."""
        ...

    def enter(self, priority: int) -> str:
        """Make the present process one of a device; return a sentence on its scheduling."""
        ...

    def run_without_collection(self) -> None:
        """Switch the garbage collector off in the present process."""

    def leave(self, code: int) -> NoReturn:
        """End the present process at once."""
        ...

    def reserve(self, device: str) -> None:
        """Keep a device for the present process until it ends; raises DeviceError where another program has it."""
        ...

    def serial_port(self, path: str, baud: int) -> Any:
        """Return a serial port, as `serial.Serial`; raises DeviceError."""
        ...

    def datagrams(self, address: str, port: int) -> socket.socket:
        """Return a connected socket for datagrams; raises DeviceError where another program has the device."""
        ...

    def arm_driver(self, make: Callable[..., Any], settings: Mapping[str, Any], model: Any, tool: Any) -> Any:
        """Return the driver of an arm, which `make` makes of the other three."""
        ...

    def controller_facts(self, address: str, probe: Callable[[str], dict[str, str]]) -> dict[str, str]:
        """Return what `probe` learns from a robot's controller; raises DeviceError where it does not answer."""
        ...

    def robot_states(self, address: str, variables: Sequence[str]) -> Any:
        """Return a robot's states, as `rtde_receive.RTDEReceiveInterface`; raises ImportError, RuntimeError."""
        ...

    def robot_commands(self, address: str) -> Any:
        """Return a robot's commands, as `rtde_control.RTDEControlInterface`; raises ImportError, RuntimeError."""
        ...

    def read_back(self, address: str, connect: Callable[[str], Any]) -> Any:
        """Return the commands that the controller has taken, by the connection that `connect` makes; raises
        RuntimeError."""
        ...


class Computer:
    """The real one."""

    def __init__(self) -> None:
        self._program = os.getpid()  # that started the present process, if it is a device's

    def start(self, role: str, module: str, descriptors: Sequence[int], settings: str) -> Process:
        """Return a child process, with an interpreter of its own, which imports nothing from the current folder."""
        command = [sys.executable, "-P", "-m", module, *map(str, descriptors), settings]
        output = sys.stderr.fileno() if _has_descriptor(sys.stderr) else subprocess.DEVNULL
        return subprocess.Popen(command, pass_fds=tuple(descriptors), stdin=subprocess.DEVNULL, stdout=output)

    def activity(self, process: Process) -> Activity | None:
        """Return the state, and the first number of ``schedstat`` [ns], by ``/proc``."""
        folder = Path(f"/proc/{process.pid}")
        try:
            state = (folder / "stat").read_text().rpartition(") ")[2][:1]
            return Activity(state, int((folder / "schedstat").read_text().split()[0]) / _SECOND)
        except (OSError, ValueError, IndexError):
            return None

    def enter(self, priority: int) -> str:
        """Leave Ctrl-C and the end of a terminal to the parent, and ask for real-time scheduling."""
        self._program = os.getppid()
        for number in (signal.SIGINT, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
        return real_time(priority)

    def run_without_collection(self) -> None:
        """Collect nothing from now on."""
        gc.freeze()
        gc.disable()

    def leave(self, code: int) -> NoReturn:
        """End the process without destructors: those of a client library sleep, hang or crash."""
        os._exit(code)

    def reserve(self, device: str) -> None:
        """Keep a device by a lock that names this program."""
        reserve(device, self._program)

    def serial_port(self, path: str, baud: int) -> Any:
        """Return the port, ours alone, with the least delay that its driver offers."""
        try:
            import serial
        except ImportError as error:
            raise DeviceError("pyserial is missing: pip install pyserial") from error
        self.reserve(f"port {os.path.realpath(path)}")  # whichever link leads to it
        try:
            port = serial.Serial(path, baud, timeout=0, exclusive=True)
        except (OSError, ValueError) as error:
            number = getattr(error, "errno", None)
            reason = os.strerror(number) if number else str(error)
            raise DeviceError(f"{path} cannot be opened: {reason}") from error
        # A pseudo-terminal has no latency timer, a chip by another maker none that can be set.
        with contextlib.suppress(OSError, ValueError, NotImplementedError, AttributeError):
            port.set_low_latency_mode(True)
        return port

    def datagrams(self, address: str, port: int) -> socket.socket:
        """Return a UDP socket; a box answers one program at a time."""
        self.reserve(f"sensor {network_device(address, port)}")
        link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            link.connect((address, port))
        except OSError:
            link.close()
            raise
        link.setblocking(False)
        return link

    def arm_driver(self, make: Callable[..., Any], settings: Mapping[str, Any], model: Any, tool: Any) -> Any:
        """Return the driver of its maker."""
        return make(settings, model, tool)

    def controller_facts(self, address: str, probe: Callable[[str], dict[str, str]]) -> dict[str, str]:
        """Return what the probe itself learns."""
        return probe(address)

    def robot_states(self, address: str, variables: Sequence[str]) -> Any:
        """Return the states by the client library."""
        import rtde_receive

        return rtde_receive.RTDEReceiveInterface(address, _STATE_RATE, list(variables))

    def robot_commands(self, address: str) -> Any:
        """Return the commands by the client library."""
        import rtde_control

        return rtde_control.RTDEControlInterface(address, _STATE_RATE)

    def read_back(self, address: str, connect: Callable[[str], Any]) -> Any:
        """Return the connection itself."""
        return connect(address)


_hosts: list[Host] = [Computer()]


def host() -> Host:
    """Return the computer that this process runs on."""
    return _hosts[-1]


@contextmanager
def use_host(other: Host) -> Iterator[None]:
    """Put another computer in its place within the context."""
    _hosts.append(other)
    try:
        yield
    finally:
        _hosts.remove(other)


def real_time(priority: int) -> str:
    """Ask for real-time scheduling of this process; return a sentence on what came of it.

    Where it computes for 3 s without a pause the system ends it: no process takes a core permanently.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (AttributeError, OSError) as error:
        return f"no real-time scheduling ({error.__class__.__name__}: not permitted)"
    with contextlib.suppress(OSError, ValueError):  # a lower limit of the system stays
        resource.setrlimit(resource.RLIMIT_RTTIME, (_SPELL, _SPELL + _GRACE))
    return f"real-time scheduling, SCHED_FIFO {priority}"


def _has_descriptor(stream: Any) -> bool:
    try:
        stream.fileno()
    except (AttributeError, OSError, ValueError):
        return False
    return True
