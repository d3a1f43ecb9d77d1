"""The robot's client library: its version, or the message where it is not installed."""

from __future__ import annotations

import importlib.metadata
import platform
from importlib.util import find_spec


def robots_here() -> str:
    """Return what this installation can do with a robot."""
    if find_spec("rtde_control") is not None:
        return f"robots of Universal Robots: ur-rtde {importlib.metadata.version('ur-rtde')}"
    return f"robots of Universal Robots: {missing_library()}"


def missing_library() -> str:
    """Return why no robot can be driven, and what can be done."""
    platform_text = f"Python {platform.python_version()} on {platform.system()} {platform.machine()}"
    return (
        f"replay and simulation only here: the client library ur-rtde is not installed for {platform_text}; "
        "its wheels are for Python 3.11 and 3.12 on Linux x86_64, elsewhere it is built with Boost and a compiler "
        "(pip install ur-rtde)"
    )
