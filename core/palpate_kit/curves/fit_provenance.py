"""``provenance.json``: by which commands, and by which versions, the rows of a folder of fits were made."""

from __future__ import annotations

import json
import os
import shlex
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from palpate import LogError
from palpate_engine import bounded_text, json_document, library_versions, write_whole

PROVENANCE = "provenance.json"


@dataclass(frozen=True)
class FitProvenance:
    """A command that made rows, its paths as seen from the folder, and the versions that it ran with."""

    command: str
    versions: Mapping[str, str]


def read_provenance(folder: Path) -> list[FitProvenance]:
    """What made the rows of a folder, the oldest first; none where nothing says so. Raises LogError."""
    path = folder / PROVENANCE
    if not path.is_file():
        return []
    try:
        return [
            FitProvenance(str(entry["command"]), {str(k): str(v) for k, v in entry["versions"].items()})
            for entry in json_document(bounded_text(path))
        ]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise LogError(f"{path}: does not say how fits were made") from error


def add_provenance(folder: Path) -> None:
    """Note the command at work with its versions, once; raises LogError, OutputError."""
    known, now = read_provenance(folder), FitProvenance(_command(folder), library_versions())
    if now not in known:
        write_provenance(folder, [*known, now])


def write_provenance(folder: Path, entries: list[FitProvenance]) -> None:
    """Write what made the rows of a folder; raises OutputError."""
    write_whole(folder / PROVENANCE, json.dumps([asdict(entry) for entry in entries], indent=2) + "\n")


def _command(folder: Path) -> str:
    """Return the command line, each path in it as seen from the folder, so that both can be moved."""
    if Path(sys.argv[0]).stem != "palpate":
        return "in Python"
    here = folder.resolve()
    words = []
    for word in sys.argv[1:]:
        head, equals, tail = word.rpartition("=") if word.startswith("--") else ("", "", word)
        there = os.path.relpath(os.path.realpath(tail), here) if tail and os.path.exists(tail) else tail
        words.append(f"{head}{equals}{there}")
    return shlex.join(["palpate", *words])
