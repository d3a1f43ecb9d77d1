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
    """What a part answers to a question; raises PluginError naming part, file and line where its code raises."""
    try:
        return question()
    except PalpateError:
        raise
    except (Exception, SystemExit) as error:
        place = _last_own_step(part, error)
        raise PluginError(f"{part.kind} {type(part).__name__} failed{when}: {error_in(error, *place)}") from error


def _last_own_step(part: Part, error: BaseException) -> tuple[FrameType, int]:
    """Frame and line in the file of a part's class that an error has passed last; else where it was raised."""
    steps = list(traceback.walk_tb(error.__traceback__))
    try:
        own = inspect.getfile(type(part))
    except (TypeError, OSError):
        own = ""
    return next((step for step in reversed(steps) if step[0].f_code.co_filename == own), steps[-1])
