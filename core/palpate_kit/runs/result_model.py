"""The models of ``result.json`` and ``fit.json``: what is read is checked by them, and the JSON schema is theirs."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any, Literal

from pydantic import ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from palpate_kit.runs.run_model import Document, Number, RunDocument, StreamDocument
from palpate_kit.runs.track_model import FlagDocument, TrackDocument

_MAX_INPUT = 40  # characters of a wrong value in a message: a choice
_TITLE = "result.json of palpate"
_ABOUT = (
    "All numbers in SI; what is not a finite number is null. Within one schema keys are added and never change their "
    "meaning or unit: leave keys alone that you do not know."
)


class ResultDocument(Document):
    """The contents of ``result.json``."""

    model_config = ConfigDict(title=_TITLE, json_schema_extra={"description": _ABOUT})

    schema_: Literal[5] = Field(alias="schema", description="form of this file")
    palpate: str = Field(description="version that wrote it")
    run: RunDocument
    streams: dict[str, StreamDocument] = Field(description="by DEVICE/STREAM")
    truth: dict[str, Number] = Field(description="true values [SI]: of a simulated device, or stated; empty otherwise")
    tracks: dict[str, TrackDocument] = Field(description="by MODEL/ESTIMATOR")


class CycleUnknownDocument(Document):
    """An unknown in one cycle."""

    value: Number
    std: Number
    unit: str


class CycleDocument(Document):
    """Results of `palpate fit` of one cycle of a motion."""

    log: str
    track: str
    cycle: int
    rms: Number
    flags: list[FlagDocument]
    unknowns: dict[str, CycleUnknownDocument]


class FitFileDocument(Document):
    """The contents of ``fit.json``, but for the results of its logs."""

    logs: dict[str, Any]
    cycles: list[CycleDocument] = Field([])


def problems(document: Mapping[str, Any], model: type[Document]) -> list[str]:
    """Return what is wrong with a document, key by key: ``tracks.dr/ekf.nis must be a valid number, not "x"``."""
    try:
        model.model_validate(document)
    except ValidationError as error:
        return [_problem(detail) for detail in error.errors(include_url=False)]
    return []


def _problem(detail: ErrorDetails) -> str:
    """Return a sentence on a key of the wrong type, or a missing one."""
    key, error_type = ".".join(map(str, detail["loc"])), detail["type"]
    if error_type == "missing":
        return f"{key} is missing"
    if error_type == "value_error":
        return f"{key}.{detail['msg'].removeprefix('Value error, ')}"
    demand = "must be a table" if error_type == "model_type" else re.sub(r"^\w+ should", "must", detail["msg"])
    return f"{key} {demand}, not {json.dumps(detail['input'])[:_MAX_INPUT]}"


def result_schema() -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of ``result.json``; open where estimators, diagnoses and devices fill
    their own."""
    schema = _without_defaults(ResultDocument.model_json_schema())
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": _TITLE, **schema}


def _without_defaults(schema: Any) -> Any:
    """Return a schema without the titles and defaults that pydantic derives from names and fields."""
    if isinstance(schema, list):
        return [_without_defaults(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    return {
        key: {name: _without_defaults(inner) for name, inner in value.items()}
        if key in ("properties", "$defs")
        else _without_defaults(value)
        for key, value in schema.items()
        if key not in ("title", "default")
    }
