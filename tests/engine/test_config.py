"""Pipeline files: what they build, and how mistakes are shown."""

import json
import tomllib

import pytest
from palpate.errors import ConfigurationError, PluginError
from palpate.hooks import KINDS
from palpate.registry import load
from palpate_commands.schema import pipeline_schema
from palpate_engine.config import load_pipeline, resolved_text


def complaint(path, *overrides):
    with pytest.raises((ConfigurationError, PluginError)) as caught:
        load_pipeline(path, overrides)
    return str(caught.value)


def test_a_reference_and_a_table_in_place_build_the_same_part(point_pipeline):
    by_name = load_pipeline(point_pipeline)
    in_place = load_pipeline(point_pipeline, ['model.dr.indenter={type = "sphere", radius = "5 mm"}'])
    assert by_name.models["dr"] == in_place.models["dr"]


def test_every_mistake_is_shown_at_once_with_its_line(point_pipeline):
    text = point_pipeline.read_text().replace('"5 mm"', '"5 kPa"').replace("poisson = 0.5", "poison = 0.5")
    text = text.replace('bias = "4 mm"', "bias = true").replace("rig.tip.z", "rig.tipp.z")
    point_pipeline.write_text(text)
    lines = text.splitlines()
    shown = complaint(point_pipeline)
    for fragment, words in {
        'radius = "5 kPa"': "[indenter.tip] radius: '5 kPa' is a pressure, not a length",
        "bias = true": "[trajectory.press] bias: expected a length",
        "[model.dr]": "[model.dr]: unknown key 'poison'; did you mean 'poisson'?",
    }.items():
        number = lines.index(fragment) + 1
        assert f"{point_pipeline}:{number}: {words}" in shown
    assert "3 mistakes" in shown


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("indenter.tip.radius=5 kPa", "'5 kPa' is a pressure, not a length"),
        ("indenter.tip.radius=0", "must be greater than 0"),
        ("indenter.tip.radus=5 mm", "unknown key 'radus'; did you mean 'radius'?"),
        ("indenter.tip.type=sfere", "no indenter 'sfere'; did you mean 'sphere'?"),
        ("model.dr.indenter=tipp", "no [indenter.tipp]; did you mean 'tip'?"),
        ("model.dr.poisson=0.6", "less than or equal to 0.5"),
        ("model.dr.poisson=inf", "must be less than or equal"),
        ("run.seed=2.7", "must be a whole number, not 2.7"),
        ("run.seed=true", "must be a whole number, not true"),
        ("run.tracks=dr/*", "must be a list"),
        ('run.tracks=["hc/*"]', "no track is called 'hc/*'"),
        ("alignment.force=rig.wrnch.z", "did you mean 'rig.wrench.z'?"),
        ("alignment.velocity=rig.tip.z", "'rig.tip.z' is in m, but velocity must be in m/s"),
        ("alignment.force.sign=2", "2 is not allowed"),
        ("alignment.tare=sometimes", "is not one of"),
        ("alignment.tip_mass=-1 g", "must be greater than or equal to 0"),
        ("device.rig.specimen.model=nope", "no [model.nope]"),
        ("device.rig.specimen.elasticity=5 mm", "elasticity: '5 mm' is a length, not a pressure"),
        ("device.rig.specimen.elastisity=5 kPa", "parameter 'elastisity' is unknown"),
        ("device.rig.pace=slow", "'slow' is not allowed"),
        ("trajectory.press.amplitude=5 mm", "must be smaller than bias"),
        ("trajektory.press.bias=4 mm", "unknown table; did you mean 'trajectory'?"),
        ("model.dr=3", 'needs type = "..."'),
        ("nonsense", "write table.key=value"),
        ("run.name.first=1", "is not a table"),
    ],
)
def test_one_mistake_one_message(point_pipeline, override, words):
    shown = complaint(point_pipeline, override)
    assert words in shown
    assert "mistakes" not in shown, "a mistake drags others along"


def test_a_part_that_needs_itself(point_pipeline):
    (point_pipeline.parent / "sleeve.py").write_text(
        "from palpate import Indenter, plugin\n"
        "class Sleeve(Indenter):\n"
        "    '''A tip around another.'''\n"
        "    inner: Indenter\n"
        "    def contact_radius(self, depth):\n"
        "        return self.inner.contact_radius(depth)\n"
        "@plugin\n"
        "def palpate_indenters():\n"
        "    return {'sleeve': Sleeve}\n"
    )
    sleeve = ['run.plugins=["sleeve.py"]', 'indenter.tip={type = "sleeve", inner = "tip"}']
    assert "[indenter.tip] inner: [indenter.tip] needs itself" in complaint(point_pipeline, *sleeve)
    proper = [*sleeve[:1], 'model.dr.indenter={type = "sleeve", inner = "tip"}']
    assert load_pipeline(point_pipeline, proper).models["dr"].indenter.inner.radius == 0.005


def test_missing_tables_are_named(tmp_path):
    empty = tmp_path / "empty.toml"
    empty.write_text("")
    shown = complaint(empty)
    for table in ("[alignment]", "[device.*]", "[model.*]", "[estimator.*]"):
        assert table in shown


def test_text_that_is_no_toml_says_where(tmp_path):
    broken = tmp_path / "broken.toml"
    broken.write_text("[run]\nname = \n")
    assert "line 2" in complaint(broken)


def test_the_resolved_pipeline_resolves_to_itself(point_pipeline, tmp_path):
    text = resolved_text(load_pipeline(point_pipeline))
    again = tmp_path / "again.toml"
    again.write_text(text)
    assert resolved_text(load_pipeline(again)) == text
    assert tomllib.loads(text)["indenter"]["tip"] == {"type": "sphere", "radius": 0.005}


def test_the_schema_knows_every_part_and_key():
    registry = load()
    schema = pipeline_schema(registry)
    json.dumps(schema)
    for kind in KINDS:
        for name, entry in registry.parts[kind].items():
            table = schema["$defs"][f"{kind}:{name}"]
            assert set(table["properties"]) == {"type", "unchecked", *entry.part.model_fields}


def test_a_plugin_beside_the_pipeline(point_pipeline):
    (point_pipeline.parent / "mine.py").write_text(
        "from palpate import Indenter, Length, plugin\n"
        "class Mine(Indenter):\n"
        "    '''A tip of mine.'''\n"
        "    radius: Length\n"
        "    def contact_radius(self, depth):\n"
        "        return (self.radius * depth) ** 0.5\n"
        "@plugin\n"
        "def palpate_indenters():\n"
        "    return {'mine': Mine}\n"
    )
    pipeline = load_pipeline(point_pipeline, ['run.plugins=["mine.py"]', "indenter.tip.type=mine"])
    assert pipeline.indenters["tip"].contact_radius(0.005) == pytest.approx(0.005)


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("import nothing_of_the_kind", "fails to import: ModuleNotFoundError"),
        ("1/0", "fails to import: ZeroDivisionError"),
        (
            "from palpate import plugin\n@plugin\ndef palpate_indenters():\n    return {'sphere': int}",
            "is not of kind Indenter",
        ),
        ("from palpate import plugin\n@plugin\ndef palpate_indenters():\n    return 3", "not a mapping"),
        (
            "from palpate import Indenter, plugin\nclass T(Indenter):\n    '''T.'''\n"
            "@plugin\ndef palpate_indenters():\n    return {'t': T}",
            "does not define contact_radius",
        ),
        (
            "from palpate import Indenter, plugin\nclass T(Indenter):\n    '''T.'''\n"
            "    def contact_radius(self, depth): return depth\n"
            "@plugin\ndef palpate_indenters():\n    return {'sphere': T}",
            "indenter 'sphere' is claimed by two plugins",
        ),
    ],
)
def test_plugins_that_break_the_rules_are_named(point_pipeline, code, words):
    (point_pipeline.parent / "bad.py").write_text(code)
    shown = complaint(point_pipeline, 'run.plugins=["bad.py"]')
    assert words in shown
    assert "bad.py" in shown


def test_a_plugin_file_that_is_not_there(point_pipeline):
    assert "does not exist" in complaint(point_pipeline, 'run.plugins=["none.py"]')
