"""Reading ``result.json``: of this version, or of an older one, whose flags were texts."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from palpate import Flag, LogError
from palpate.host import SCHEMA, registry as registries, verdict


def read_result(path: Path) -> dict[str, Any]:
    """A result as this version writes it; raises LogError for what is none, or of a newer palpate."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise LogError(f"{path}: is no result of palpate: {error}") from error
    return upgraded(document, path)


def is_whole(path: Path) -> bool:
    """Whether a result can be read as a document at all; half a file, or none, means that the run is not done."""
    try:
        return isinstance(json.loads(path.read_text(encoding="utf-8")), dict)
    except (OSError, ValueError, RecursionError):
        return False


def upgraded(document: Any, path: Path) -> dict[str, Any]:
    """A result's document as this version writes it; raises LogError like `read_result`."""
    if not isinstance(document, dict) or not isinstance(document.get("tracks"), dict):
        raise LogError(f"{path}: is no result of palpate: it has no tracks")
    schema = document.get("schema", 1)
    if schema not in range(1, SCHEMA + 1):
        by = document.get("palpate", "another version")
        raise LogError(f"{path}: has schema {schema} (of palpate {by}); this palpate reads up to {SCHEMA}: update it")
    if schema == 1:
        for track in document["tracks"].values():
            flags = read_flags(track.get("flags", []))
            track |= {"flags": [flag.table() for flag in flags], "verdict": verdict(flags)}
    live = document.get("run", {}).get("live", {})
    if "rest" in live:
        live["standstill"] = live.pop("rest")
    return {**document, "schema": SCHEMA}


def read_flags(entries: Sequence[Any]) -> tuple[Flag, ...]:
    """Judged flags from a document: objects, or texts ``code: sentence`` of schema 1."""
    if all(isinstance(entry, dict) for entry in entries):
        return tuple(Flag(**entry) for entry in entries)
    texts = [str(entry).partition(": ") for entry in entries]
    return registries.load().judged(Flag(code, message) for code, _, message in texts)
