"""The two ends of a device process: the parent's `Child`, and what the child does with what it is given."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
from collections import deque
from typing import Any, Self

from palpate import DeviceError, clock

from palpate_kit.acquisition.computer import Activity, host
from palpate_kit.acquisition.ring import Ring, ring_size, shared_memory

_SECOND = 1e9  # [ns]
_BEAT_EVERY = 0.025  # [s]: a choice
_LOOK = 0.02  # [s] between looks whether a process that gets ready has failed: a choice
_CHUNK = 65_536  # bytes that are read from the socket at once
_MAX_DESCRIPTORS = 4  # that may come with one message
_SUSPECT = 0.5  # of the longest time without a beat, after which it is looked what the process does
_COMPUTES = 0.2  # of the time since then, that a process computes which has a core
_OUTSIDE = {  # signals that a process does not send itself, and who does
    signal.SIGKILL: "the system does so where memory is short (`dmesg` names the process), else another program",
    signal.SIGTERM: "another program, or a person, has ended it",
    signal.SIGXCPU: "it computed for 3 s at real-time priority without a pause",
}
_STATES = {  # of a process that does not beat, and the cause
    "D": "it waits within the system, as where memory is swapped out or a disk or a port is busy",
    "T": "another program has stopped it (SIGSTOP)",
    "S": "its driver waits for something, and does not return",
}


class Child:
    """A process that runs one module of a device, as its parent sees it: a ring to read, a socket for the rest.

    The process gets its settings as JSON. When the parent goes, however it goes, the socket closes, and the child
    is to put the device at rest and leave. When the child goes or stops beating, the parent kills it and says so.
    """

    def __init__(
        self, name: str, role: str, module: str, settings: dict[str, Any], columns: int, hint: str = ""
    ) -> None:
        """Start the process of a `role` ("robot", "sensor") that runs a module with `settings` for it (JSON).

        Its readings are in a ring in shared memory, in rows of so many `columns`; all other messages pass a socket.
        `hint` is a clause on what a sudden end means.
        """
        self.name = name
        self._hint = hint  # what a sudden end means
        ours, theirs = socket.socketpair()  # the ends of the parent and of the child
        memory = shared_memory(ring_size(columns))
        try:
            self._process = host().start(role, module, (theirs.fileno(), memory), json.dumps(settings))
            self.ring = Ring(memory, columns)
            self.memory = os.dup(memory)  # for the child to inherit
        except BaseException:
            ours.close()
            raise
        finally:
            theirs.close()
            os.close(memory)
        self._socket = ours
        self._text = b""
        self._unread: deque[dict[str, Any]] = deque()
        self._closing = clock().event()
        self.fault: str | None = None
        self._suspected: tuple[float, Activity] | None = None  # since when [s], and what it did then
        self._beating = clock().thread(self._beat, f"{name} heartbeat", urgent=True)
        self._beating.start()

    def _beat(self) -> None:
        while not self._closing.wait(_BEAT_EVERY):
            self.ring.beat(clock().now_ns(), host=True)

    def messages(self, timeout: float = 0.0) -> list[dict[str, Any]]:
        """Return the messages of the child since the last call, waiting up to `timeout` [s] for something."""
        self._receive(0.0 if self._unread else timeout)
        messages = list(self._unread)
        self._unread.clear()
        return messages

    def _receive(self, timeout: float = 0.0) -> None:
        """Take all lines of JSON that the child has sent, after a wait of at most `timeout` [s]; keep a part of one."""
        with contextlib.suppress(ConnectionError):
            while clock().wait([self._socket], timeout):
                timeout = 0.0
                data = self._socket.recv(_CHUNK)
                if not data:
                    break
                self._text += data
        *lines, self._text = self._text.split(b"\n")
        for line in lines:
            message = json.loads(line)
            if message.get("say") == "fault":
                self.fault = str(message["text"])
            self._unread.append(message)

    def wait_for(self, word: str, timeout: float) -> dict[str, Any]:
        """Return the first message of a kind; raises DeviceError on a fault, on death and after `timeout` [s].

        `messages` returns those that came after it.
        """
        deadline = clock().now() + timeout
        while clock().now() < deadline:
            self._receive(_LOOK)
            while self._unread:
                if (message := self._unread.popleft())["say"] == word:
                    return message
            self.check()
        self.kill()
        raise DeviceError(f"{self.name}: is not ready within {timeout:g} s")

    def check(self, beat_limit: float | None = None) -> None:
        """Raise DeviceError where the child has reported a fault, has died, or has not beaten for so long [s]."""
        code = self._process.poll()  # once: what it said before its end is read after it
        if self.fault is None and code is not None:
            self._receive()
        if self.fault is not None:
            raise DeviceError(f"{self.name}: {self.fault}")
        if code is not None:
            raise DeviceError(f"{self.name}: its process ended ({_ending(code, self._hint)}")
        # A process that lives may still hang: its heartbeat shows that.
        beat = self.ring.last_beat()
        if beat_limit is not None and beat:
            self._check_beat((clock().now_ns() - beat) / _SECOND, beat_limit)

    def _check_beat(self, age: float, limit: float) -> None:
        """Kill a child whose latest beat is older than a limit [s], and raise DeviceError with what it did."""
        if age <= _SUSPECT * limit:
            self._suspected = None
            return
        if self._suspected is None and (activity := host().activity(self._process)) is not None:
            self._suspected = clock().now(), activity
        if age > limit:
            cause = self._silence_cause()
            self.kill()
            text = f"{self.name}: its process gave no sign of life for {1e3 * age:.0f} ms and was killed"
            raise DeviceError(f"{text}{cause}")

    def _silence_cause(self) -> str:
        """Return a clause on why the process does not beat, by what the system says of it now."""
        activity = host().activity(self._process)
        if activity is None or self._suspected is None:
            return clock().late_computer()
        # It either computes, which shows in its processor time, or waits for a core.
        since, earlier = self._suspected
        if activity.state != "R":
            return f": {_STATES[activity.state]}" if activity.state in _STATES else ""
        elapsed = clock().now() - since
        if activity.processor_time - earlier.processor_time > _COMPUTES * elapsed:
            return ": it computes without a pause"
        return clock().late_computer(f"the process was ready and got no core for {1e3 * elapsed:.0f} ms")

    def tell(self, word: str, **facts: Any) -> None:
        """Send the child a message."""
        with contextlib.suppress(OSError):
            self._socket.sendall(json.dumps({"say": word, **facts}).encode() + b"\n")

    def hand_over(self, word: str, descriptor: int, **facts: Any) -> None:
        """Send the child a message with an open file, such as shared memory."""
        data = json.dumps({"say": word, **facts}).encode() + b"\n"
        with contextlib.suppress(OSError):
            socket.send_fds(self._socket, [data], [descriptor])

    @property
    def alive(self) -> bool:
        """True if the process runs."""
        return self._process.poll() is None

    @property
    def pid(self) -> int:
        """The process's number."""
        return self._process.pid

    def kill(self) -> None:
        """End the process without asking it."""
        with contextlib.suppress(ProcessLookupError):
            self._process.kill()
        self._process.wait()

    def close(self, timeout: float = 2.0) -> None:
        """Let the process end on its own, and end it where it does not."""
        self.tell("close")
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)
        try:
            self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            self.kill()
        self._receive()
        self._closing.set()
        self._beating.join()
        self._socket.close()
        os.close(self.memory)


class Parent:
    """The parent, as the child sees it."""

    def __init__(self, descriptor: int) -> None:
        self._socket = socket.socket(fileno=descriptor)
        self._socket.setblocking(False)
        self._text = b""
        self.gone = False
        self.descriptors: list[int] = []  # of the files that came with messages, in their order
        self._received: list[int] = []  # all of them

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for descriptor in self._received:
            os.close(descriptor)
        self._socket.close()

    def fileno(self) -> int:
        """Return the descriptor at which messages arrive."""
        return self._socket.fileno()

    def tell(self, word: str, **facts: Any) -> None:
        """Send the parent a message; one that is gone does not matter."""
        with contextlib.suppress(OSError):
            self._socket.sendall(json.dumps({"say": word, **facts}).encode() + b"\n")

    def messages(self) -> list[dict[str, Any]]:
        """Return the messages of the parent since the last call; sets `gone` where it has closed its end or died."""
        try:
            data, descriptors, _, _ = socket.recv_fds(self._socket, _CHUNK, _MAX_DESCRIPTORS)
            self.descriptors += descriptors
            self._received += descriptors
            self.gone = self.gone or not data
        except BlockingIOError:
            return []
        except OSError:
            self.gone = True
            return []
        self._text += data
        *lines, self._text = self._text.split(b"\n")
        return [json.loads(line) for line in lines]


def _ending(code: int, hint: str) -> str:
    """Return what ended a process, by its exit code, with the bracket closed; `hint`: what an end by itself means."""
    if code >= 0:
        return f"exit code {code}){hint}"
    name, outside = signal.Signals(-code).name, _OUTSIDE.get(signal.Signals(-code))
    return f"killed by {name}: {outside})" if outside is not None else f"killed by {name}){hint}"
