"""An error of a part's own code, named by the part and by the place in its file."""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Callable
from types import FrameType
from typing import TypeVar

from palpate.errors import PalpateError, PluginError, error_in
from palpate.parts import Part

_T = TypeVar("_T")


def answer_of(part: Part, question: Callable[[], _T], when: str = "") -> _T:
    """Return the answer of a part to a question; raises PluginError with part, file and line where its code raises."""
    try:
        return question()
    except PalpateError:
        raise
    except (Exception, SystemExit) as error:
        place = _last_step_in_part(part, error)
        raise PluginError(f"{part.kind} {type(part).__name__} failed{when}: {error_in(error, *place)}") from error


def _last_step_in_part(part: Part, error: BaseException) -> tuple[FrameType, int]:
    """Return the last frame and line of an error in the file of a part's class; else those that raised it."""
    steps = list(traceback.walk_tb(error.__traceback__))
    try:
        part_file = inspect.getfile(type(part))
    except (TypeError, OSError):
        part_file = ""
    for step in reversed(steps):
        if step[0].f_code.co_filename == part_file:
            return step
    return steps[-1]
