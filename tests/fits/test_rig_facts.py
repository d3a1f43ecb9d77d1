"""Facts of a rig: options, ``rig.toml`` beside the curves, ``curves.csv`` and pipelines state the same settings."""

import inspect
import json
from typing import get_args

import numpy as np
import palpate as python
import palpate_engine as engine
import pytest
from palpate import ConfigurationError
from palpate_engine import RigFacts, facts_stated, option_of, question_of, words_that_state

from tests.fits.test_fit_files import press, rows_of

PIPELINE = """
[run]
rig = "rig.toml"

[device.log]
type = "csv-replay"
file = "curves/0.csv"
time = { column = 0, unit = "s" }
columns = { force = { column = 1, unit = "N" }, position = { column = 2, unit = "mm" } }

[alignment]
force = "log.force"
position = "log.position"
STATED

TIP
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"

[estimator.fit]
type = "casadi-fit"
"""
TIP = """
[indenter.tip]
type = "sphere"
radius = "3 mm"
"""
EVERY = """
tip = "sphere 3 mm"
tip_uncertainty = "20 um"
thickness = "22 mm +- 0.5 mm"
delay = "1 ms +- 0.2 ms"
tip_mass = "140 g +- 2 g"
tare = "zeroed before contact"
poisson = 0.5
inclination = "0 deg"
mount = "200 N/mm"
position = "tip"
"""


@pytest.fixture
def curves(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "curves").mkdir()
    for i in range(2):
        time, height, force = press(i)
        columns = np.column_stack([time, force, height])
        np.savetxt(f"curves/{i}.csv", columns, delimiter=",", header="time_s,force_N,height_mm", comments="")
    return tmp_path


def loaded(folder, rig, stated="", overrides=(), tip=TIP):
    (folder / "rig.toml").write_text(rig)
    (folder / "p.toml").write_text(PIPELINE.replace("STATED", stated).replace("TIP", tip))
    return engine.load_pipeline(folder / "p.toml", overrides)


def test_every_fact_of_the_file_is_a_setting_of_the_pipeline(curves):
    pipeline = loaded(curves, EVERY)
    alignment, model = pipeline.alignment, pipeline.models["dr"]
    assert (alignment.force.delay, alignment.timing_uncertainty) == pytest.approx((1e-3, 2e-4))
    assert (alignment.tip_mass, alignment.tip_mass_uncertainty) == pytest.approx((0.14, 0.002))
    assert (alignment.tare, alignment.tare_uncertainty) == (0.0, 0.0)
    assert (alignment.series_stiffness, alignment.position.measured) == (200e3, True)
    assert (model.thickness.height, model.poisson, model.skin.inclination) == (0.022, 0.5, 0.0)
    declared = {"height": "0.5 mm", "poisson": engine.POISSON_STD, "radius": "20 um"}
    assert dict(pipeline.run.uncertainties) == declared
    again = engine.build_pipeline(engine.Source(engine.resolved_text(pipeline), curves / "resolved.toml"))
    assert again.alignment == alignment  # what was used stands in the resolved pipeline, without the file
    assert again.models["dr"] == model


def test_the_uncertainty_of_a_paraboloid_is_that_of_its_radius_of_curvature(curves):
    rig = 'tip = "paraboloid 3 mm"\ntip_uncertainty = "20 um"'
    pipeline = loaded(curves, rig, tip='[indenter.tip]\ntype = "paraboloid"\ncurvature_radius = "3 mm"')
    assert dict(pipeline.run.uncertainties) == {"curvature_radius": "20 um"}


@pytest.mark.parametrize(
    ("rig", "stated", "words"),
    [
        ('tip = "sphere 4 mm"', "", ("rig.toml: tip", "p.toml:", "radius 3 mm", "radius 4 mm")),
        ('tip_mass = "140 g"', 'tip_mass = "0.15 kg"', ("rig.toml: tip_mass", "p.toml:14", "0.15 kg", "140 g")),
        ('tare = "none"', 'tare = "free-air"', ("rig.toml: tare", "free-air", "none")),
    ],
)
def test_a_pipeline_that_states_another_value_is_refused_with_both_named(curves, rig, stated, words):
    with pytest.raises(ConfigurationError) as refused:
        loaded(curves, rig, stated)
    assert all(word in str(refused.value) for word in words), refused.value


def test_the_same_value_in_another_unit_is_no_contradiction(curves):
    pipeline = loaded(curves, 'tip_mass = "140 g"\ntip = "sphere diameter 6 mm"', "tip_mass = 0.14")
    assert pipeline.alignment.tip_mass == 0.14


def test_the_command_line_goes_before_the_file_and_the_pipeline(curves):
    stated = 'tip_mass = "150 g"'
    pipeline = loaded(curves, 'thickness = "22 mm"', stated, ["rig.tip_mass=140 g", "rig.thickness=half-space"])
    assert pipeline.alignment.tip_mass == 0.14
    assert pipeline.models["dr"].thickness == "half-space"


@pytest.mark.parametrize(
    ("rig", "words"),
    [
        ('thicknes = "22 mm"', "rig.toml:1: unknown key 'thicknes'; did you mean 'thickness'?"),
        ('thickness = "22"', "rig.toml:1: thickness: '22' has no unit"),
        ('thickness = "22 kPa"', "is a pressure, not a length"),
        ('thickness = "-1 mm"', "must be above 0"),
        ('delay = "0 ms"', 'Write its standard uncertainty, as "0 ms +- ..."'),
        ('delay = "0 ms +- 1 ms +- 2 ms"', "more than one uncertainty"),
        ('tare = "free air"', "'free air' is not a force"),
        ('tare = "free-air 5 N"', "is a force, not a time"),
        ('tare = "1.8 N"', "standard uncertainty"),
        ('position = "stge"', "'stge' is not allowed"),
        ('columns = { forc = "F" }', "no role 'forc'; did you mean 'force'?"),
        ("tip = 3", "tip: must be a text"),
        ("tip = ", "not TOML"),
    ],
)
def test_a_mistake_in_the_file_is_named_with_its_line(curves, rig, words):
    with pytest.raises(ConfigurationError) as refused:
        loaded(curves, rig)
    assert words in str(refused.value)


def test_every_fact_of_a_condition_has_a_key_an_option_and_a_question():
    parameters = inspect.signature(engine.analysis("fit"), eval_str=True).parameters.values()
    marks = [mark for one in parameters for mark in get_args(one.annotation)[1:]]
    options = {text for mark in marks for text in (mark.default, *(mark.param_decls or ()))}
    for fact, key in facts_stated().items():
        assert option_of(key) in options
        assert words_that_state(fact).startswith(option_of(key))
        question, example = question_of(key)
        assert question.endswith("?")
        engine.facts_of({key: example})  # the example is an answer
    assert all(described.description for described in RigFacts.model_fields.values())


@pytest.mark.slow
def test_the_file_beside_the_curves_is_found_and_said_and_one_command_is_enough(curves, palpate):
    (curves / "curves" / "rig.toml").write_text('tip = "paraboloid 3 mm"\ndelay = "0 ms +- 0.1 ms"\ntip_mass = "0 g"\n')
    (curves / "curves" / "curves.csv").write_text("curve,thickness,batch\n1.csv,5 mm,b\n")
    done = palpate("fit", "curves", "--out", "out")
    assert done.returncode == 0, done.stderr
    assert "facts of the rig: curves/rig.toml" in done.stderr
    assert "curves.csv states thickness of 1 of 2 curves" in done.stderr
    models = "dr, nu 0.5, half-space (1 curve) or dr, nu 0.5, 5 mm thick (1 curve)"
    assert f"paraboloid, curvature radius 3 mm; {models}; " in " ".join(done.stdout.split())
    rows = rows_of(curves / "out")
    assert float(rows["0"]["elasticity"]) == pytest.approx(1e5, rel=0.01)
    assert rows["1"]["verdict"] == "doubtful"  # its record is of no layer of 5 mm
    options = ["--thickness", "half-space", "--rig", "curves/rig.toml"]
    again = palpate("fit", "curves", "--out", "thick", *options)
    rows = rows_of(curves / "thick")
    assert float(rows["1"]["elasticity"]) == pytest.approx(1.1e5, rel=0.01), again.stderr
    changed = palpate("fit", "out", "--where", "curve=curves/0.csv", "--thickness", "5 mm")
    assert changed.returncode == 0, changed.stderr
    assert rows_of(curves / "out")["0"]["verdict"] == "doubtful"


@pytest.mark.slow
def test_run_and_indentation_read_the_same_file(curves, palpate):
    (curves / "rig.toml").write_text('thickness = "20 mm"\ntare = "none"\n')
    (curves / "p.toml").write_text(PIPELINE.replace("STATED", "").replace("TIP", TIP))
    ran = palpate("run", "p.toml", "--json", "--out", "run")
    assert ran.returncode == 0, ran.stderr
    track = json.loads(ran.stdout)["tracks"]["dr/fit"]
    assert track["parameters"]["elasticity"]["value"] < 0.95e5
    pressed = palpate("fit", "indentation", "p.toml", "--out", "pressed")
    assert pressed.returncode == 0, pressed.stderr
    contradicted = palpate("fit", "curves/0.csv", "--pipeline", "p.toml", "--set", "model.dr.thickness=half-space")
    assert contradicted.returncode == 0, contradicted.stderr  # the command line goes before the file


@pytest.mark.slow
def test_python_reads_the_same_file_and_refuses_what_contradicts_the_record(curves):
    (curves / "rig.toml").write_text('tip = "paraboloid 3 mm"\nthickness = "20 mm"\ntip_mass = "0 g"\n')
    record = python.read("curves/0.csv", timing="0.1 ms")
    thin = python.fit(record, rig="rig.toml")
    assert thin.elasticity.value < 0.95e5
    keys = python.fit(record, rig={"tip": "paraboloid 3 mm", "thickness": "20 mm", "tip_mass": "0 g"})
    assert keys.elasticity.value == thin.elasticity.value
    (curves / "rig.toml").write_text('tip = "paraboloid 3 mm"\nthickness = "half-space"\ntip_mass = "0 g"\n')
    thick = python.fit(record, rig="rig.toml")  # another content is another fit
    assert thick.elasticity.value == pytest.approx(1e5, rel=0.01)
    weighed = python.read("curves/0.csv", tip_mass="140 g")
    with pytest.raises(ConfigurationError, match="tip_mass contradicts"):
        python.fit(weighed, rig="rig.toml")
