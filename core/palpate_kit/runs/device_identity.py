"""Identity of a device among the facts that it states, such as its serial number."""

from __future__ import annotations

from collections.abc import Mapping


def is_identity(key: str) -> bool:
    """Return True if a fact of this name distinguishes one device from another of its kind."""
    return "serial" in key or key == "identity"


def other_identity(before: Mapping[str, str], present: Mapping[str, str]) -> str | None:
    """Return the first identifying fact in which two devices differ; None where none that both state does."""
    return next(
        (key for key in sorted(before.keys() & present.keys()) if is_identity(key) and before[key] != present[key]),
        None,
    )
