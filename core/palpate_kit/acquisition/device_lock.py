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
_LONGEST = 100  # characters of a command in a message
_held: dict[str, int] = {}  # descriptors of this process by file; the system frees them when it ends, however it ends


def network_device(address: str, port: int) -> str:
    """Return the name of a device on the net: its number where the host's name has one."""
    with suppress(OSError):  # then connecting says so
        address = socket.gethostbyname(address)
    return f"{address}:{port}"


def reserve(device: str, program: int, folder: Path = FOLDER) -> None:
    """Keep a device for this process, on behalf of a program by its process number.

    Raises DeviceError naming the program that has it. A file of a process that has ended is not a lock.
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
    for _ in range(3):
        with suppress(FileNotFoundError):
            return os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
        with suppress(FileExistsError):
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
            os.fchmod(handle, 0o666)  # whatever the umask
            return handle
    raise FileNotFoundError(2, "it comes and goes")


def _description(program: int) -> dict[str, Any]:
    return {
        "program": program,
        "process": os.getpid(),
        "command": _command(program),
        "folder": _folder(program),
        "since": datetime.now().astimezone().isoformat(timespec="seconds"),
    }


def _folder(program: int) -> str:
    """Where the program runs, by which its relative paths are read."""
    try:
        return str(Path(f"/proc/{program}/cwd").readlink())
    except OSError:
        return str(Path.cwd())


def _command(program: int) -> str:
    try:
        words = Path(f"/proc/{program}/cmdline").read_bytes().decode(errors="replace").split("\0")[:-1]
    except OSError:
        words = sys.argv
    # "python3 /somewhere/bin/palpate run x.toml" is `palpate run x.toml`
    begin = next((at for at, word in enumerate(words[:3]) if Path(word).name == "palpate"), None)
    return textwrap.shorten(" ".join(words if begin is None else ["palpate", *words[begin + 1 :]]), _LONGEST)


def _holder(handle: int) -> str:
    """Who holds a lock, as a message calls it."""
    try:
        found = json.loads(os.pread(handle, 65536, 0))
        since = datetime.fromisoformat(found["since"])
        program, process = int(found["program"]), int(found["process"])
        begun = f"process {program}, in {found['folder']}, since {since:%H:%M:%S on %Y-%m-%d}"
        text = f"`{found['command']}` ({begun})"
    except (OSError, ValueError, KeyError, TypeError):
        return "another program"
    if process == program or Path(f"/proc/{program}").exists():
        return text
    return f"{text}, which has ended; its process {process} is still at the device"
