"""The errors of palpate, drawn as a tree.

::

    PalpateError                exit code 1: not the user's doing
    ├── DeviceError             a robot, sensor or link failed while in use
    │   └── UnstoppedArmError   exit code 3: an arm was stopped, and no states show that it stands
    ├── StoppedError            exit code 128 + signal: stopped from outside; the result is partial
    └── UserError               exit code 2: something the user can mend
        ├── ConfigurationError  a pipeline file or a command line says something impossible
        ├── PluginError         a plugin cannot be loaded, clashes, or breaks its interface
        │   └── ConsentError    a plugin file may not be executed without consent
        ├── LogError            a recorded log cannot be read, or does not hold what is asked of it
        └── OutputError         a result cannot be written to its destination
"""

from __future__ import annotations

import traceback
from collections.abc import Iterable, Mapping
from dataclasses import FrozenInstanceError
from difflib import get_close_matches
from pathlib import Path
from types import FrameType, MappingProxyType

RAISED_BY_PARTS = (Exception, SystemExit)  # by code of others; exit() in a part is a mistake of the part
_SHOWN = 12  # a choice: names in a message
_SIMILARITY = 0.6  # a choice, that of difflib: names at least so similar are suggested
_SIGNAL_EXIT = 128  # POSIX shells: the exit code of a process that a signal ended, less the signal's number
_SHARED = "; all plugins share the readings and estimates of a run, so they are read-only: change a copy"


class PalpateError(Exception):
    """Anything that palpate raises on purpose."""

    exit_code = 1


class DeviceError(PalpateError):
    """A robot, a sensor or the link to it failed while in use."""

    arm_stands = False  # of an arm: its own process has seen 0.1 s of states that show that its tip stands


class UnstoppedArmError(DeviceError):
    """An arm was stopped, and no states show that it stands: a person has to press the emergency stop."""

    exit_code = 3
    speed: float | None = None  # [m/s] of its tip, where states show one


class StoppedError(PalpateError):
    """A signal ended a run before its end."""

    def __init__(self, message: str, number: int) -> None:
        super().__init__(message)
        self.exit_code = _SIGNAL_EXIT + number

    def __reduce__(self) -> tuple[type[StoppedError], tuple[str, int]]:
        return StoppedError, (str(self), self.exit_code - _SIGNAL_EXIT)


class UserError(PalpateError):
    """Something that the user can mend; shown without a traceback."""

    exit_code = 2


class ConfigurationError(UserError):
    """A pipeline file or a command line says something that cannot be."""

    by_table: Mapping[tuple[str, ...], str] = MappingProxyType({})  # what is wrong, by path of a pipeline's tables


class PluginError(UserError):
    """A plugin cannot be loaded, clashes with another one, or breaks its interface."""


class ConsentError(PluginError):
    """A plugin file may not be executed without consent; a command ends with it, whatever else it could do."""


class LogError(UserError):
    """A recorded log cannot be read, or does not hold what is asked of it."""


class OutputError(UserError):
    """A result cannot be written to its destination."""


def error_text(error: BaseException) -> str:
    """Return the text of an error; that of another program's code with its type."""
    return str(error) if isinstance(error, PalpateError) else f"{type(error).__name__}: {error}"


def error_in(error: BaseException, frame: FrameType | None = None, line: int = 0) -> str:
    """Return ``ValueError: no (my_filter.py, line 12, in run)``: an error of other people's code, and its place.

    The place is that at which it was raised, unless a frame and a line of it are given.
    """
    if frame is None:
        *_, (frame, line) = traceback.walk_tb(error.__traceback__)
    message = " ".join(f"{type(error).__name__}: {error}".split())
    place = f"{Path(frame.f_code.co_filename).name}, line {line}, in {frame.f_code.co_name}"
    return f"{message} ({place}){_SHARED if _is_write(error) else ''}"


def _is_write(error: BaseException) -> bool:
    """Return True for what numpy, or a frozen dataclass, raises where somebody writes to a shared block."""
    return isinstance(error, FrozenInstanceError) or (isinstance(error, ValueError) and "read-only" in str(error))


def suggest(given: str, allowed: Iterable[str]) -> str:
    """Return ``; did you mean 'x'? (there are: x, y)`` for messages about an unknown name."""
    names = sorted(allowed)
    close = get_close_matches(given, names, n=_SHOWN, cutoff=_SIMILARITY)
    meant = f"; did you mean {close[0]!r}?" if close else ""
    shown = names if len(names) <= _SHOWN else [*(close or names[:_SHOWN]), "..."]
    return f"{meant} (there {'is' if len(names) == 1 else 'are'}: {', '.join(shown) or 'none'})"
