"""Lines that a user types, or a program writes, to running twins."""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

READ_BYTES = 4096  # at once (a choice: many lines)


class Console:
    """The standard input, where it is open: each line is answered."""

    def __init__(self, answer: Callable[[list[str]], str], commands: Mapping[str, str]) -> None:
        self._answer, self._commands = answer, commands
        self._listening = _has_speaker()
        self._typed = ""  # an incomplete line
        self.ended = False  # by `quit`, or by the end of the input

    @property
    def inputs(self) -> list[Any]:
        """Files to wait for in addition to the sockets: the standard input, where it is open."""
        return [sys.stdin] if self._listening else []

    def read(self, ready: Sequence[Any]) -> None:
        """Answer the lines that were typed, if the standard input is ready.

        It is read past Python's buffer, of which `select` does not know.
        """
        if sys.stdin not in ready:
            return
        try:
            data = os.read(sys.stdin.fileno(), READ_BYTES)
        except OSError:  # its terminal has gone
            self._listening = False
            return
        self.ended = self.ended or not data
        *lines, self._typed = (self._typed + data.decode(errors="replace")).split("\n")
        for line in map(str.split, lines):
            command = line[0] if line else ""
            if command == "help":
                print("\n".join(f"{name}: {meaning}" for name, meaning in self._commands.items()), flush=True)
            elif command:
                print(self._answer(line), flush=True)
            self.ended = self.ended or command == "quit"


def _has_speaker() -> bool:
    """Return True if the standard input is a person or a program, not /dev/null, as in the background of a shell."""
    if sys.stdin is None or sys.stdin.closed:
        return False
    return sys.stdin.isatty() or not stat.S_ISCHR(os.fstat(sys.stdin.fileno()).st_mode)
