"""``provenance.json``: the commands and versions that made the rows of a folder of fits."""

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
    """A command that made rows, with paths relative to the folder, and the versions of the libraries that it used."""

    command: str
    versions: Mapping[str, str]


def read_provenance(folder: Path) -> list[FitProvenance]:
    """Return the commands that made the rows of a folder, the oldest first; empty without the file. Raises LogError."""
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
    """Add the running command with its versions, unless it is noted already; raises LogError, OutputError."""
    entries = read_provenance(folder)
    running_command = FitProvenance(_command_line(folder), library_versions())
    if running_command not in entries:
        write_provenance(folder, [*entries, running_command])


def write_provenance(folder: Path, entries: list[FitProvenance]) -> None:
    """Write the commands that made the rows of a folder; raises OutputError."""
    write_whole(folder / PROVENANCE, json.dumps([asdict(entry) for entry in entries], indent=2) + "\n")


def _command_line(folder: Path) -> str:
    """Return the command line with paths relative to the folder, so that both can be moved together."""
    if Path(sys.argv[0]).stem != "palpate":
        return "in Python"
    arguments = []
    for argument in sys.argv[1:]:
        option, equals, text = argument.rpartition("=") if argument.startswith("--") else ("", "", argument)
        if text and os.path.exists(text):
            text = os.path.relpath(os.path.realpath(text), folder.resolve())
        arguments.append(f"{option}{equals}{text}")
    return shlex.join(["palpate", *arguments])
