"""Libraries that only a notebook needs."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from palpate import UserError


def library(name: str) -> Any:
    """Return a library of the extra ``notebook``; raises UserError where it is not installed."""
    try:
        return import_module(name)
    except ImportError as error:
        raise UserError(f"this needs {name}, which is not installed: pip install 'palpate[notebook]'") from error
