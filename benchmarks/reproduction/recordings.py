"""The authors' files on this machine, known by their SHA-256, whatever they are called."""

from __future__ import annotations

import gzip
import hashlib
import struct
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path

from palpate import LogError

from reproduction.item import AuthorsRecording

_BLOCK = 1 << 20


def find(folder: Path, wanted: Mapping[str, AuthorsRecording]) -> dict[str, Path]:
    """Which file in a folder, plain or gzipped, is which recording; those that are not there are left out.

    Raises LogError where the folder cannot be read.
    """
    if not folder.is_dir():
        raise LogError(f"{folder}: no such folder")
    sizes = {recording.bytes for recording in wanted.values()}
    names = {recording.sha256: name for name, recording in wanted.items()}
    found: dict[str, Path] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and _size(path) in sizes:
            name = names.get(_sha256(path))
            if name is not None:
                found.setdefault(name, path)
    return found


def how_to_get(recordings: Iterable[AuthorsRecording]) -> str:
    """A line for each recording, for a person with a network."""
    return "\n".join(f"  {recording.url}" for recording in recordings)


def _size(path: Path) -> int:
    """Size of a file's contents [bytes], unpacked; as gzip states it, modulo 2^32."""
    if path.suffix != ".gz":
        return path.stat().st_size
    with path.open("rb") as file:
        if file.seek(0, 2) < 18:
            return -1
        file.seek(-4, 2)
        return int(struct.unpack("<I", file.read(4))[0])


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            while block := file.read(_BLOCK):
                digest.update(block)
    except (OSError, EOFError, zlib.error):
        return ""
    return digest.hexdigest()
