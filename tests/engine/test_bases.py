"""``[run] base``: tables of a rig that pipelines share, and what is refused."""

import json
import shutil
import tomllib

import pytest
from palpate_engine import load_pipeline, resolved_text

LAB = """
[device.rig]
type = "sim"
tip_mass = "140 g"
[device.rig.specimen]
model = "dr"
elasticity = "112.5 kPa"
viscosity = "362 Pa*s"
[alignment]
force = "rig.wrench.z"
position = "rig.tip.z"
velocity = "rig.twist.z"
measuring = "rig.setpoint.measuring"
tip_mass = "140 g"
[safety]
low = ["-5 mm", "-5 mm", "-7 mm"]
high = ["5 mm", "5 mm", "20 mm"]
speed = "40 mm/s"
stop_force = "12 N"
force = "20 N"
stiffness = "3 N/mm"
[indenter.tip]
type = "sphere"
radius = "5 mm"
"""
STUDY = """
[run]
name = "study"
base = ["{base}"]
[trajectory.press]
type = "point"
bias = "4 mm"
duration = "2 s"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
[estimator.ekf]
type = "ekf"
"""


@pytest.fixture
def files(tmp_path):
    """Write files by their names; the path of the study."""

    def write(lab=LAB, study="", base="lab/lab.toml", **others):
        (tmp_path / "lab").mkdir(exist_ok=True)
        (tmp_path / "lab" / "lab.toml").write_text(lab)
        for name, text in others.items():
            (tmp_path / "lab" / f"{name}.toml").write_text(text)
        (tmp_path / "study.toml").write_text(STUDY.format(base=base) + study)
        return tmp_path / "study.toml"

    return write


def test_the_tables_of_a_rig_are_shared_and_the_resolved_pipeline_needs_no_base(files, tmp_path):
    pipeline = load_pipeline(files())
    assert pipeline.indenters["tip"].radius == 0.005
    assert pipeline.safety.speed == 0.04
    text = resolved_text(pipeline)
    assert f"# indenter.tip.radius: {tmp_path}/lab/lab.toml:24\n" in text
    shutil.rmtree(tmp_path / "lab")
    (tmp_path / "resolved.toml").write_text(text)
    again = load_pipeline(tmp_path / "resolved.toml")
    assert tomllib.loads(resolved_text(again)) == tomllib.loads(text)


def test_keys_of_the_file_win_one_by_one_and_a_table_of_another_type_replaces(files):
    study = '[safety]\nspeed = "20 mm/s"\n[indenter.tip]\ntype = "cone"\nangle = "30 deg"\n'
    study += '[alignment]\nforce = { delay = "3 ms" }\n'
    pipeline = load_pipeline(files(study=study))
    assert (pipeline.safety.speed, pipeline.safety.force) == (0.02, 20.0)
    assert type(pipeline.indenters["tip"]).__name__ == "Cone"
    assert (pipeline.alignment.force.channel, pipeline.alignment.force.delay) == ("rig.wrench.z", 0.003)
    assert "safety.force" in pipeline.inherited
    assert not {"safety.speed", "indenter.tip.radius", "indenter.tip.type"} & set(pipeline.inherited)
    assert pipeline.looser_limits == ()


def test_later_bases_win_and_a_base_may_have_a_base(files, tmp_path):
    tip = '[indenter.tip]\ntype = "sphere"\nradius = "3 mm"\n'
    rig = f'[run]\nbase = ["lab.toml"]\n{tip}'
    pipeline = load_pipeline(files(rig=rig, base="lab/rig.toml"))
    assert pipeline.indenters["tip"].radius == 0.003
    assert pipeline.inherited["indenter.tip.radius"] == f"{tmp_path}/lab/rig.toml:5"
    two = files(rig=tip, base='lab/lab.toml", "lab/rig.toml')
    assert load_pipeline(two).indenters["tip"].radius == 0.003
    lists = load_pipeline(files(study='[safety]\nhigh = ["1 mm", "1 mm", "9 mm"]\n'))
    assert lists.safety.high == pytest.approx((0.001, 0.001, 0.009))


def test_the_command_line_wins(files):
    pipeline = load_pipeline(files(), ["indenter.tip.radius=2 mm", "safety.speed=10 mm/s"])
    assert pipeline.indenters["tip"].radius == 0.002
    assert "indenter.tip.radius" not in pipeline.inherited


def test_a_path_is_relative_to_the_file_that_states_it(files, tmp_path):
    profile = "radius,height\n" + "".join(f"{1e-3 * r},{1e-4 * r * r}\n" for r in range(9))
    study = files(lab=LAB.replace('type = "sphere"\nradius = "5 mm"', 'type = "profile"\npoints = "tip.csv"'))
    (tmp_path / "lab" / "tip.csv").write_text(profile)
    assert load_pipeline(study).indenters["tip"].points == tmp_path / "lab" / "tip.csv"


def test_a_looser_limit_is_a_line_of_check_and_a_note_of_the_run(files, palpate, tmp_path):
    study = files(study='[safety]\nspeed = "60 mm/s"\nlow = ["-5 mm", "-5 mm", "-6 mm"]\nlatency = "10 ms"\n')
    sentence = "[safety] speed: '60 mm/s' is looser than '40 mm/s' of the base"
    checked = palpate("check", study)
    assert checked.returncode == 0, checked.stderr
    assert sentence in checked.stderr
    assert "low" not in checked.stderr
    assert f"{tmp_path}/lab/lab.toml: alignment.force, " in checked.stdout
    shown = json.loads(palpate("check", study, "--json").stdout)
    assert shown["inherited"]["safety.force"] == f"{tmp_path}/lab/lab.toml:20"
    done = palpate("run", study, "--out", tmp_path / "out")
    assert sentence in done.stderr
    flags = json.loads((tmp_path / "out" / "result.json").read_text())["tracks"]["dr/ekf"]["flags"]
    assert sentence in [flag["message"] for flag in flags]


@pytest.mark.parametrize(
    ("others", "complaint"),
    [
        ({"base": "lab/none.toml"}, "study.toml:4: [run] base: {0}/lab/none.toml: cannot read"),
        ({"base": "study.toml"}, "study.toml:4: [run] base: a file is its own base: study.toml -> study.toml"),
        (
            {"base": "lab/rig.toml", "rig": '[run]\nbase = ["again.toml"]\n', "again": '[run]\nbase = ["rig.toml"]\n'},
            "again.toml:2: [run] base: a file is its own base: study.toml -> rig.toml -> again.toml -> rig.toml",
        ),
        ({"lab": '[run]\nplugins = ["own.py"]\n'}, "lab.toml:2: [run] plugins: a base holds only [device.*]"),
        ({"lab": '[model.dr]\ntype = "fung"\n'}, "lab.toml:1: model.dr: a base holds only"),
        ({"lab": "[device.rig\n"}, "lab.toml:1: not TOML"),
        ({"lab": 'palpate = "99.0"\n'}, "written for palpate 99.0"),
        ({"lab": LAB.replace('radius = "5 mm"', 'radius = "5 N"')}, "lab.toml:24: [indenter.tip] radius"),
    ],
)
def test_a_wrong_base_is_named_with_file_and_line(files, palpate, tmp_path, others, complaint):
    done = palpate("check", files(**others))
    assert done.returncode == 2
    assert complaint.format(tmp_path) in done.stderr
    assert "Traceback" not in done.stderr


def test_a_base_that_is_no_list(files, palpate):
    done = palpate("check", files(), "--set", "run.base=3")
    assert done.returncode == 2
    assert '--set run.base: [run] base: must be a list of files, such as ["lab.toml"]' in done.stderr


def test_the_pair_of_the_examples(palpate, root, tmp_path):
    study = root / "pipelines" / "shared" / "study.toml"
    pipeline = load_pipeline(study)
    assert (pipeline.alignment.force.channel, pipeline.indenters["tip"].radius) == ("rig.wrench.z", 0.003)
    done = palpate("run", study, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    resolved = tomllib.loads((tmp_path / "out" / "pipeline.toml").read_text())
    assert resolved["alignment"]["force"]["channel"] == "rig.wrench.z"
    assert resolved["run"].get("base", []) == []
