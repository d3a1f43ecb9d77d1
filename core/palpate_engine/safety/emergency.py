"""The call for the emergency stop: what a person reads and hears at once."""

from __future__ import annotations

import sys
from contextlib import suppress

EMERGENCY = "PRESS THE EMERGENCY STOP"
_BELL = "\a"


def call_for_stop(text: str) -> None:
    """Print a sentence on standard error, with the bell; a terminal that has gone stops nothing."""
    with suppress(Exception):
        print(f"{_BELL}palpate: {text}", file=sys.stderr, flush=True)
