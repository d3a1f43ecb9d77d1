"""One device, one program: a lock by the address or the port of a device, which names the program that holds it."""

from __future__ import annotations

import fcntl
import json
import os
import re
import socket
import sys
import textwrap
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from palpate import DeviceError

FOLDER = Path("/tmp")  # the same one for all users and their environments
_MAX_COMMAND = 100  # characters of a command in a message: a choice
_MODE = 0o666  # every user may lock and write
_ATTEMPTS = 3  # to open a lock that other programs make and remove meanwhile: a choice
_MAX_CONTENT = 65_536  # bytes that are read of a lock
_LEADING = 3  # words of a command among which palpate's own is: interpreter, option, script
_held: dict[str, int] = {}  # descriptors of this process by file; the system frees them when it ends, however it ends


def network_device(address: str, port: int) -> str:
    """Return the name of a device on the net: its number where the host's name has one."""
    with suppress(OSError):  # then connecting says so
        address = socket.gethostbyname(address)
    return f"{address}:{port}"


def reserve(device: str, program: int, folder: Path = FOLDER) -> None:
    """Keep a device for this process by a lock on a file, which names the `program` (process number) that has it.

    The lock is held until this process ends. Raises DeviceError naming the program that has it. A file of a process
    that has ended is not a lock.
    """
    path = folder / f"palpate-{re.sub(r'[^A-Za-z0-9.]+', '-', device).strip('-')}.lock"
    if str(path) in _held:
        return
    try:
        handle = _opened(path)
    except OSError as error:
        raise DeviceError(f"{device} cannot be reserved: {path}: {error.strerror}") from error
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        text = _holder(handle)
        os.close(handle)
        raise DeviceError(f"{device} is in use by {text}; one device serves one run") from error
    _held[str(path)] = handle
    with suppress(OSError):  # no room: the lock holds, and names nobody
        os.ftruncate(handle, 0)
        os.pwrite(handle, json.dumps(_description(program)).encode(), 0)


def _opened(path: Path) -> int:
    """Return the file of a lock, which programs of every user may lock and write."""
    for _ in range(_ATTEMPTS):
        with suppress(FileNotFoundError):
            return os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
        with suppress(FileExistsError):
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, _MODE)
            os.fchmod(handle, _MODE)  # whatever the umask
            return handle
    raise FileNotFoundError(2, "it comes and goes")


def _description(program: int) -> dict[str, Any]:
    """Return what a lock states of its owner: process, command, folder and time."""
    return {
        "program": program,
        "process": os.getpid(),
        "command": _command(program),
        "folder": _folder(program),
        "since": datetime.now().astimezone().isoformat(timespec="seconds"),
    }


def _folder(program: int) -> str:
    """Return the folder in which the program runs, by which its relative paths are read."""
    try:
        return str(Path(f"/proc/{program}/cwd").readlink())
    except OSError:
        return str(Path.cwd())


def _command(program: int) -> str:
    """Return the command line of a process, shortened; that of this process if it cannot be read."""
    try:
        command = Path(f"/proc/{program}/cmdline").read_bytes().decode(errors="replace").split("\0")[:-1]
    except OSError:
        command = sys.argv
    # "python3 /somewhere/bin/palpate run x.toml" is `palpate run x.toml`
    begin = next((number for number, part in enumerate(command[:_LEADING]) if Path(part).name == "palpate"), None)
    return textwrap.shorten(" ".join(command if begin is None else ["palpate", *command[begin + 1 :]]), _MAX_COMMAND)


def _holder(handle: int) -> str:
    """Return who holds a lock, as a message calls it."""
    try:
        description = json.loads(os.pread(handle, _MAX_CONTENT, 0))
        since = datetime.fromisoformat(description["since"])
        program, process = int(description["program"]), int(description["process"])
        begun = f"process {program}, in {description['folder']}, since {since:%H:%M:%S on %Y-%m-%d}"
        text = f"`{description['command']}` ({begun})"
    except (OSError, ValueError, KeyError, TypeError):
        return "another program"
    if process == program or Path(f"/proc/{program}").exists():
        return text
    return f"{text}, which has ended; its process {process} is still at the device"
