"""Processes of devices as threads in simulated time."""

from __future__ import annotations

import importlib
import os
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

from palpate import DeviceError, HoldUp

from palpate_kit.acquisition.computer import Activity, Process, use_host
from palpate_kit.simulated_time.simulated_clock import SimulatedClock
from palpate_kit.simulated_time.simulated_turns import EndOfThread


class _ProcessExitError(BaseException):
    def __init__(self, code: int) -> None:
        self.code = code


class SimulatedProcess:
    """A device's process as a thread in simulated time (a Process)."""

    def __init__(
        self,
        clock: SimulatedClock,
        name: str,
        module: str,
        arguments: Sequence[str],
        pid: int,
        closed: Callable[[], None] | None = None,
    ) -> None:
        """Start a thread that runs a module's `main` with `arguments`: open files, then settings (JSON)."""
        self.returncode: int | None = None
        self.pid, self.name = pid, name
        self._clock, self._module, self._arguments = clock, module, arguments
        self._closed = closed  # what becomes of its connections at its end
        self._thread = clock.process_thread(self._run, module, self.name)
        self._thread.start()

    def _run(self) -> None:
        """Run the module as a process does, with its exit code; close its connections at the end."""
        code = 1
        try:
            importlib.import_module(self._module).main(self._arguments)
            code = 0
        except _ProcessExitError as end:
            code = end.code
        except EndOfThread:
            code = -signal.SIGKILL
            raise
        except Exception:
            traceback.print_exc(file=sys.stderr)
        finally:
            self.returncode = code
            if self._closed is not None:
                self._closed()
            os.close(int(self._arguments[1]))  # the descriptor of its shared memory
            self._clock.kill(self.name)

    def poll(self) -> int | None:
        """Its exit code; None while it runs."""
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end; raises subprocess.TimeoutExpired."""
        self._thread.join(timeout)
        if self.returncode is None:
            raise subprocess.TimeoutExpired(self._module, timeout or 0.0)
        return self.returncode

    def kill(self) -> None:
        """End it."""
        if self.returncode is None:
            self._clock.kill(self.name)


class SimulatedComputer:
    """A computer whose processes are threads (a Host), and which reaches nothing outside of this process."""

    def __init__(self, clock: SimulatedClock) -> None:
        self._clock = clock
        self._started = 0

    def start(self, role: str, module: str, descriptors: Sequence[int], settings: str) -> Process:
        """Return the process as a thread, with open files of its own."""
        self._started += 1
        arguments = [*(str(os.dup(descriptor)) for descriptor in descriptors), settings]
        return SimulatedProcess(
            self._clock, f"{role} {self._started}", module, arguments, self._started, self.end_of(role)
        )

    def activity(self, process: Process) -> Activity | None:
        """Return that it waits for a core where the computer holds it up, and sleeps otherwise."""
        assert isinstance(process, SimulatedProcess)
        return Activity("R" if self._clock.is_held_up(process.name) else "S", 0.0)

    def end_of(self, role: str) -> Callable[[], None] | None:
        """Return a function for the end of a process, for its connections; None without one."""
        return None

    def enter(self, priority: int) -> str:
        """Return the scheduling: nothing competes for a core."""
        return "simulated time"

    def run_without_collection(self) -> None:
        """Do nothing: collecting takes no simulated time."""

    def leave(self, code: int) -> NoReturn:
        """End the process that the calling thread belongs to."""
        raise _ProcessExitError(code)

    def reserve(self, device: str) -> None:
        """Do nothing: no other program can reach the twin."""

    def serial_port(self, path: str, baud: int) -> Any:
        """Raise DeviceError: it has no port."""
        raise DeviceError(f"{path} cannot be opened: no port in simulated time")

    def datagrams(self, address: str, port: int) -> Any:
        """Raise DeviceError: it has no network."""
        raise DeviceError(f"{address} cannot be reached: no network in simulated time")

    def arm_driver(self, make: Callable[..., Any], settings: Mapping[str, Any], model: Any, tool: Any) -> Any:
        """Return the driver of its maker, which has to use `palpate.clock()`."""
        return make(settings, model, tool)

    def controller_facts(self, address: str, probe: Callable[[str], dict[str, str]]) -> dict[str, str]:
        """Raise DeviceError: it has no network."""
        raise DeviceError(f"{address}: no network in simulated time")

    def robot_states(self, address: str, variables: Sequence[str]) -> Any:
        """Raise RuntimeError: it has no network."""
        raise RuntimeError("no network in simulated time")

    def robot_commands(self, address: str) -> Any:
        """Raise RuntimeError: it has no network."""
        raise RuntimeError("no network in simulated time")

    def read_back(self, address: str, connect: Callable[[str], Any]) -> Any:
        """Raise RuntimeError: it has no network."""
        raise RuntimeError("no network in simulated time")


@contextmanager
def simulated_time(hold_ups: Sequence[HoldUp] = ()) -> Iterator[SimulatedClock]:
    """Yield simulated time in this process, for devices that need nothing outside of it, such as an arm in software."""
    clock = SimulatedClock(hold_ups)
    with clock.running(), use_host(SimulatedComputer(clock)):
        yield clock
