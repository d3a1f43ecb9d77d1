"""The module path of palpate, and of the Python programs that it starts: never the current folder."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_SAFE_PATH = "PYTHONSAFEPATH"  # environment variable of Python


@contextmanager
def safe_processes() -> Iterator[None]:
    """Within the context, Python programs that are started import nothing from the current folder.

    Python looks there first for ``-c`` and ``-m``, also in the processes of `multiprocessing`: a file `signal.py` among
    the curves would be executed in place of Python's own.
    """
    before = os.environ.get(_SAFE_PATH)
    os.environ[_SAFE_PATH] = "1"
    try:
        yield
    finally:
        os.environ.pop(_SAFE_PATH)
        os.environ.update({_SAFE_PATH: before} if before is not None else {})


@contextmanager
def without_current_folder() -> Iterator[None]:
    """Within the context this program imports nothing from the current folder, where ``python -c`` looks first."""
    before = sys.path[:]
    sys.path[:] = filter(None, before)
    try:
        yield
    finally:
        sys.path[:] = before
