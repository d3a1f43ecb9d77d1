"""Lines that a user types, or a program writes, to running twins."""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any


class Console:
    """The standard input, where it is open: each line is answered."""

    def __init__(self, answer: Callable[[list[str]], str], commands: Mapping[str, str]) -> None:
        self._answer, self._commands = answer, commands
        self._listening = _somebody_speaks()
        self._typed = ""
        self.ended = False  # by `quit`, or by the end of the input

    @property
    def inputs(self) -> list[Any]:
        """What to wait for in addition to the sockets."""
        return [sys.stdin] if self._listening else []

    def read(self, ready: Sequence[Any]) -> None:
        """Answer what was typed, if the standard input is ready; read past its buffer, which `select` cannot see."""
        if sys.stdin not in ready:
            return
        try:
            data = os.read(sys.stdin.fileno(), 4096)
        except OSError:  # its terminal has gone
            self._listening = False
            return
        self.ended = self.ended or not data
        *lines, self._typed = (self._typed + data.decode(errors="replace")).split("\n")
        for words in map(str.split, lines):
            if words[:1] == ["help"]:
                print("\n".join(f"{name}: {meaning}" for name, meaning in self._commands.items()), flush=True)
            elif words:
                print(self._answer(words), flush=True)
            self.ended = self.ended or words[:1] == ["quit"]


def _somebody_speaks() -> bool:
    """Return True if the standard input is a person or a program, not /dev/null, as in the background of a shell."""
    if sys.stdin is None or sys.stdin.closed:
        return False
    return sys.stdin.isatty() or not stat.S_ISCHR(os.fstat(sys.stdin.fileno()).st_mode)
