"""``review.json``: marks on a run, or on parts of it, with reasons; nothing is deleted."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from palpate import LogError
from palpate_engine import bounded_text, json_document, write_whole

REVIEW = "review.json"
Mark = Literal["bad", "good", "none"]


@dataclass(frozen=True)
class Marks:
    """Rejected parts with their reasons, and accepted ones, by name; the name of the run itself is empty."""

    rejected: dict[str, str] = field(default_factory=dict)
    accepted: dict[str, str] = field(default_factory=dict)


def read_marks(folder: Path) -> Marks:
    """Return the marks of a folder; raises LogError for a file that is not a review."""
    path = folder / REVIEW
    if not path.is_file():
        return Marks()
    try:
        tables = json_document(bounded_text(path))
        kinds = (tables["rejected"], tables.get("accepted", {}))
        return Marks(*({str(name): str(reason) for name, reason in marks.items()} for marks in kinds))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise LogError(f"{path}: is not a review of palpate") from error


def write_mark(folder: Path, name: str, mark: Mark, reason: str = "") -> None:
    """Mark the run of a folder, or a part by its name; raises LogError, OutputError."""
    marks = read_marks(folder)
    for marks_of_kind in (marks.rejected, marks.accepted):
        marks_of_kind.pop(name, None)
    if mark == "bad":
        marks.rejected[name] = reason
    elif mark == "good":
        marks.accepted[name] = reason
    document: dict[str, dict[str, str]] = {"rejected": marks.rejected}
    if marks.accepted:
        document["accepted"] = marks.accepted
    write_whole(folder / REVIEW, json.dumps(document, indent=2) + "\n")
