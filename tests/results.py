"""Every result.json that a test writes, live or simulated, whole or cut, is held against its JSON schema."""

import json
from contextlib import contextmanager
from functools import cache

import jsonschema
import pytest
from palpate_engine.pipeline import pipeline_run
from palpate_kit.runs.result_model import result_schema


def closed(schema):
    """The schema without room for keys that it does not name, but for what plugins fill as they like."""
    if isinstance(schema, dict):
        found = {key: closed(value) for key, value in schema.items()}
        if isinstance(found.get("properties"), dict):
            found.setdefault("additionalProperties", False)
        return found
    return [closed(item) for item in schema] if isinstance(schema, list) else schema


@cache
def validator():
    return jsonschema.Draft202012Validator(closed(result_schema()))


def mistakes(document):
    """What a result's document has that its schema does not allow, or lacks."""
    return [f"{error.json_path}: {error.message[:200]}" for error in validator().iter_errors(document)]


@contextmanager
def checked():
    """Within the context a result that is written and is not what the schema says is an error."""
    write = pipeline_run.write_new

    def written(path, text):
        if path.name == "result.json":
            assert mistakes(json.loads(text)) == [], path
        return write(path, text)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pipeline_run, "write_new", written)
        yield


def all_codes(*flags):
    """Codes of flags and of the signs under them, of results and of lists of flags: whether they matter or not."""
    found = set()
    for one in flags:
        every = (*one.flags, *getattr(one, "immaterial", ())) if hasattr(one, "flags") else one
        for flag in every:
            found |= {flag.code, *(sign.code for sign in flag.evidence)}
    return found
