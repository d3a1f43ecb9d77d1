"""Numbers without a unit that were hardly meant are refused; who means them says so."""

import tomllib

import pytest
from palpate import ConfigurationError
from palpate.registry import load
from palpate_commands.schema import pipeline_schema
from palpate_engine.config import load_pipeline, resolved_text
from palpate_engine.config.unit_plausibility import implausible_units

REGISTRY = load()


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("trajectory.press.bias=4", '[trajectory.press] bias: 4 without a unit is 4 m; did you mean "4 mm"?'),
        ("alignment.tip_mass=140", 'did you mean "140 g"?'),
        ("alignment.force.delay=5", 'did you mean "5 ms"?'),
        ("indenter.tip.radius=5", 'did you mean "5 mm"?'),
        ("device.rig.tip_mass=140", 'did you mean "140 g"?'),
        ("device.rig.specimen.surface=30", 'did you mean "30 mm"?'),
    ],
)
def test_a_number_that_was_hardly_meant_is_refused(palpate, point_pipeline, setting, words):
    done = palpate("check", point_pipeline, "--set", setting)
    assert done.returncode == 2
    assert words in done.stderr
    assert f"--set {setting.partition('=')[0]}" in done.stderr
    key = setting.rpartition(".")[2].partition("=")[0]
    table = setting.rpartition(".")[0]
    meant = palpate("check", point_pipeline, "--set", setting, "--set", f'{table}.unchecked=["{key}"]')
    assert "without a unit" not in meant.stderr


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        (
            "device.rig.specimen.elasticity=112.5",
            'elasticity: 112.5 without a unit is 112.5 Pa; did you mean "112.5 kPa"?',
        ),
        ("alignment.tare=1800", '1800 without a unit is 1800 N; did you mean "1800 mN"?'),
        ("estimator.ekf.first_guess={elasticity=100}", '100 without a unit is 100 Pa; did you mean "100 kPa"?'),
        ("estimator.ekf.first_guess_std={elasticity=50}", 'did you mean "50 kPa"?'),
    ],
)
def test_numbers_by_other_names_are_doubted_too(palpate, point_pipeline, setting, words):
    done = palpate("check", point_pipeline, "--set", setting)
    assert done.returncode == 2
    assert words in " ".join(done.stderr.split())
    key, _, value = setting.rpartition("=")
    number = value.strip("}")
    unit = '"' + number + (" N" if "tare" in key else " Pa") + '"'
    meant = palpate("check", point_pipeline, "--set", f"{key}={value.replace(number, unit)}")
    assert "without a unit" not in meant.stderr


def test_what_was_meant_is_read_back(point_pipeline):
    """A very soft specimen, with its unit: resolved it has none any more."""
    text = resolved_text(load_pipeline(point_pipeline, ["device.rig.specimen.elasticity=400 Pa"]))
    point_pipeline.write_text(text)
    assert load_pipeline(point_pipeline).devices["rig"].specimen.parameters["elasticity"] == 400.0


def test_it_is_refused_in_a_file_with_its_line(point_pipeline):
    text = point_pipeline.read_text().replace('bias = "4 mm"', "bias = 4")
    point_pipeline.write_text(text)
    with pytest.raises(ConfigurationError, match=rf"point\.toml:{text.splitlines().index('bias = 4') + 1}: .*4 mm"):
        load_pipeline(point_pipeline)
    point_pipeline.write_text(text.replace("bias = 4", 'bias = "4 m"'))
    assert load_pipeline(point_pipeline).trajectories["press"].bias == 4.0


def test_what_is_unchecked_must_be_a_key(point_pipeline):
    with pytest.raises(ConfigurationError, match="unknown key 'biass'; did you mean 'bias'"):
        load_pipeline(point_pipeline, ['trajectory.press.unchecked=["biass"]'])
    with pytest.raises(ConfigurationError, match="must be a list of keys"):
        load_pipeline(point_pipeline, ["trajectory.press.unchecked=true"])


def test_a_resolved_pipeline_is_read_back(point_pipeline):
    text = resolved_text(load_pipeline(point_pipeline, ["trajectory.press.bias=4 m"]))
    assert tomllib.loads(text)["trajectory"]["press"]["unchecked"] == ["bias"]
    point_pipeline.write_text(text)
    assert resolved_text(load_pipeline(point_pipeline)) == text
    plain = resolved_text(load_pipeline(point_pipeline, ["trajectory.press.bias=4 mm"]))
    assert "unchecked" not in plain


@pytest.mark.parametrize(("kind", "name"), [(k, n) for k, entries in REGISTRY.parts.items() for n in entries])
def test_no_default_is_doubted(kind, name):
    part = REGISTRY.find(kind, name)
    defaults = {key: field.default for key, field in part.model_fields.items() if not field.is_required()}
    assert implausible_units(part, defaults) == {}


@pytest.mark.slow
def test_the_schema_knows_the_key():
    jsonschema = pytest.importorskip("jsonschema")
    schema = {**pipeline_schema(REGISTRY)["$defs"]["trajectory:point"], "$defs": pipeline_schema(REGISTRY)["$defs"]}
    jsonschema.validate({"type": "point", "bias": 4, "unchecked": ["bias"]}, schema)
