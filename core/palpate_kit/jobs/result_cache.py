"""Results of runs, kept next to them: an answer that was lost on its way is read there, and not computed twice."""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

from palpate_engine import Result, bounded_text, finite_tree, json_document, write_whole
from pydantic import TypeAdapter

ANSWER = "answer.json"  # with all that result.json leaves out; it comes last, when the run folder is whole


def write_cache(result: Result) -> None:
    """Write the result of a run into its folder; raises OutputError."""
    document = asdict(result)
    for track in document["tracks"].values():
        track |= {key: finite_tree(track[key]) for key in ("details", "diagnoses")}
        if track["report"] is not None:
            pairs = track["report"]["correlations"]
            track["report"]["correlations"] = [[*pair, value] for pair, value in pairs.items()]
    write_whole(result.folder / ANSWER, json.dumps(document, default=_plain) + "\n")


def read_cached(folder: Path) -> Result | None:
    """Return the result of the run in a folder; None where it is not whole, or of a palpate that wrote it otherwise."""
    try:
        document = json_document(bounded_text(folder / ANSWER))
        for track in document["tracks"].values():
            if track["report"] is not None:
                pairs = track["report"]["correlations"]
                track["report"]["correlations"] = {(first, second): value for first, second, value in pairs}
        return _results().validate_python(document | {"folder": folder})
    except (OSError, ValueError, KeyError, TypeError, AttributeError):  # ValidationError is a ValueError
        return None


@cache
def _results() -> TypeAdapter[Result]:
    return TypeAdapter(Result)


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else str(value)
