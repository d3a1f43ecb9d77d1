"""Force curves exported as text by afmformats, whose ending is that of any table with tabs."""

from __future__ import annotations

from pathlib import Path

ENDING = ".tab"
_METADATA = b"# BEGIN METADATA"
_HEAD = 1 << 16  # [bytes] in which the metadata begin


def is_exported_curve(path: Path) -> bool:
    """Return True for a text of this ending with the metadata of a force curve."""
    if not path.name.lower().endswith(ENDING):
        return False
    with path.open("rb") as file:
        return _METADATA in file.read(_HEAD)
