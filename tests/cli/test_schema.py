"""`palpate describe schema`: what the editor says is what the run says."""

import json
import re
import tomllib
from copy import deepcopy
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator
from palpate.registry import load
from palpate_commands.schema import pipeline_schema
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_engine.result import SCHEMA
from palpate_kit.runs.result_model import result_schema

from tests.results import mistakes

ROOT = Path(__file__).parent.parent.parent
NEEDED = {"device", "alignment", "model", "estimator"}
WITH_DOCUMENTS = ("benchmarks", "docs", "plugins", "tests")  # not .venv, .git, and what is built
DOCUMENTS = [*ROOT.glob("*.md"), *(path for folder in WITH_DOCUMENTS for path in (ROOT / folder).rglob("*.md"))]
BLOCKS = [
    pytest.param(path, text, id=f"{path.relative_to(ROOT)}-{number}")
    for path in sorted(DOCUMENTS)
    for number, text in enumerate(re.findall(r"^```toml\n(.*?)^```$", path.read_text(), re.MULTILINE | re.DOTALL))
    if set(tomllib.loads(text)) >= NEEDED
]
PLUGIN = re.compile(r"^```python\n# file: (\S+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def validator():
    schema = pipeline_schema(load())
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


@pytest.fixture(scope="module")
def point():
    return tomllib.loads((ROOT / "pipelines" / "filters.toml").read_text())


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """What a short run has found."""
    text = (ROOT / "pipelines" / "filters.toml").read_text()
    folder = tmp_path_factory.mktemp("result")
    (folder / "point.toml").write_text(text)
    pipeline = load_pipeline(folder / "point.toml", ["trajectory.press.duration=1 s"])
    return json.loads(json.dumps(run_pipeline(pipeline, folder / "out").table()))


def test_the_schema_of_results_is_printed(palpate):
    schema = json.loads(palpate("describe", "schema", "result").stdout)
    Draft202012Validator.check_schema(schema)
    assert schema == result_schema()
    assert schema["properties"]["schema"]["const"] == SCHEMA
    done = palpate("describe", "schema", "results")
    assert done.returncode == 2
    assert "'pipeline', 'result'" in done.stderr


def test_every_key_of_a_result_is_explained():
    """But for the objects and rows that stand under a name of their own."""

    def unexplained(schema, path=""):
        if isinstance(schema, dict):
            for name, value in (schema.get("properties") or {}).items():
                if "description" not in value and "$ref" not in value:
                    yield f"{path}.{name}"
            for key, value in schema.items():
                yield from unexplained(value, f"{path}/{key}")

    assert list(unexplained(result_schema())) == []


def _track(document):
    return next(iter(document["tracks"].values()))


@pytest.mark.parametrize(
    "spoil",
    [
        lambda d: d.pop("truth"),
        lambda d: d.update(schema=3),
        lambda d: d["run"].update(log_duration=None),
        lambda d: d["run"]["tare"].pop("noise"),
        lambda d: _track(d).update(verdict="fine"),
        lambda d: _track(d)["flags"].append({"code": "Odd One", "message": "odd", "severity": "note"}),
        lambda d: _track(d)["flags"].append("odd: a text, as in schema 1"),
        lambda d: _track(d)["parameters"]["elasticity"].update(value="112 kPa"),
        lambda d: _track(d)["parameters"]["elasticity"].pop("combined"),
        lambda d: _track(d)["budget"][0]["effects"].update(elasticity=1.0),
        lambda d: next(iter(d["streams"].values())).update(samples=-1),
    ],
)
def test_what_is_no_result_is_refused(result, spoil):
    whole = Draft202012Validator(result_schema())
    assert whole.is_valid(result)
    assert mistakes(result) == []
    spoilt = deepcopy(result)
    spoil(spoilt)
    assert not whole.is_valid(spoilt)


def test_keys_of_a_later_version_are_let_alone(result):
    later = {**result, "mood": 3}
    assert Draft202012Validator(result_schema()).is_valid(later)
    assert mistakes(later)  # but the tests of this version know all keys that it writes


PIPELINES = [path for path in sorted((ROOT / "pipelines").rglob("*.toml")) if path.name != "lab.toml"]  # a base alone


@pytest.mark.parametrize("pipeline", PIPELINES, ids=lambda path: path.stem)
def test_every_shipped_pipeline_is_accepted(validator, pipeline):
    assert [error.message for error in validator.iter_errors(tomllib.loads(pipeline.read_text()))] == []


@pytest.mark.slow
@pytest.mark.parametrize(("document", "text"), BLOCKS)
def test_every_pipeline_in_a_document_is_accepted(tmp_path, document, text):
    tables = tomllib.loads(text)
    for name, source in PLUGIN.findall(document.read_text()):
        (tmp_path / name).write_text(source)
    files = [tmp_path / name for name in tables.get("run", {}).get("plugins", [])]
    validator = Draft202012Validator(pipeline_schema(load(files)))
    assert [error.message for error in validator.iter_errors(tables)] == []


MISTAKES = {
    "unknown table": (("estimater",), {}),
    "unknown key": (("model", "dr", "poison"), 0.5),
    "unknown key of alignment": (("alignment", "tip_masse"), "140 g"),
    "unknown key of a signal": (("alignment", "force", "sing"), -1),
    "unknown part": (("estimator", "ekf", "type"), "ekff"),
    "no type": (("estimator", "ekf"), {}),
    "wrong type": (("run", "seed"), "one"),
    "text in place of a list": (("run", "tracks"), "dr/ekf"),
    "a wrong choice": (("alignment", "force", "sign"), 2),
    "below the least": (("model", "dr", "poisson"), -0.1),
    "another dimension": (("trajectory", "press", "bias"), "4 kPa"),
    "no unit in a text": (("trajectory", "press", "bias"), "4"),
    "a tare that is no word": (("alignment", "tare"), "free air"),
    "part that is a number": (("model", "dr", "indenter"), 5),
    "a table in place of a text": (("alignment", "position"), {}),
    "a kind without names": (("model", "type"), "dimensionality-reduction"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_typical_mistake_is_caught(validator, point, mistake):
    location, value = MISTAKES[mistake]
    wrong = deepcopy(point)
    table = wrong
    for key in location[:-1]:
        table = table[key]
    table[location[-1]] = value
    assert not validator.is_valid(wrong)


@pytest.mark.parametrize(
    ("location", "value", "complaint"),
    [
        (("model", "dr", "poison"), 0.5, "'poison' was unexpected"),
        (("indenter", "tip", "radus"), "5 mm", "'radus' was unexpected"),
        (("estimator", "ekf", "type"), "ekff", "'ekff' is not one of"),
        (("estimator", "ekf"), {}, "'type' is a required property"),
        (("trajectory", "press", "bias"), "4 kPa", "'4 kPa' is not valid under any of the given schemas"),
        (("model", "dr", "indenter"), {"type": "sphere", "radus": 5}, "'radus' was unexpected"),
    ],
)
def test_a_validator_names_the_key(validator, point, location, value, complaint):
    wrong = deepcopy(point)
    table = wrong
    for key in location[:-1]:
        table = table[key]
    table[location[-1]] = value
    errors = [error for error in validator.iter_errors(wrong) if complaint in error.message]
    assert errors, [error.message for error in validator.iter_errors(wrong)]
    assert tuple(errors[0].absolute_path) == location[: len(errors[0].absolute_path)]
    assert len(errors[0].absolute_path) >= 2


def test_it_is_no_larger_than_with_all_parts_in_each_place(monkeypatch):
    monkeypatch.setenv("PALPATE_PLUGINS", "off")  # each part of another distribution has its own characters
    assert len(json.dumps(pipeline_schema(load()))) <= 652_000


@pytest.mark.parametrize(
    ("location", "value"),
    [
        (("alignment", "tare"), "1.8 N"),
        (("alignment", "tare"), "none"),
        (("alignment", "tare"), -0.4),
        (("alignment", "force"), "rig.wrench.z"),
        (("model", "dr", "thickness"), "none"),
        (("model", "dr", "indenter"), {"type": "sphere", "radius": "5 mm"}),
        (("trajectory", "press", "bias"), 0.004),
        (("trajectory", "press", "bias"), "4 millimeter"),
        (("trajectory", "press", "bias"), "4e3 µm"),
        (("device", "rig", "specimen"), {"model": "dr", "name": "S2"}),
    ],
)
def test_other_ways_to_write_are_accepted(validator, point, location, value):
    other = deepcopy(point)
    table = other
    for key in location[:-1]:
        table = table[key]
    table[location[-1]] = value
    assert [error.message for error in validator.iter_errors(other)] == []


@pytest.mark.slow
def test_it_is_written_to_a_file(palpate, tmp_path):
    assert palpate("describe", "schema", "-o", "palpate.schema.json").stdout == ""
    assert json.loads((tmp_path / "palpate.schema.json").read_text()) == json.loads(
        palpate("describe", "schema").stdout
    )
    assert palpate("describe", "schema", "-o", "nowhere/schema.json").returncode == 2


@pytest.mark.parametrize("pipeline", sorted((ROOT / "pipelines").glob("*.toml")), ids=lambda path: path.stem)
def test_the_examples_name_it(pipeline):
    assert pipeline.read_text().startswith("#:schema palpate.schema.json\n")
