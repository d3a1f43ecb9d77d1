"""Mistakes of a part's author: the true culprit, one sentence, the exit code, and the results of the others."""

import json

import pytest

MODEL = """
from palpate import ContactModel, Indenter, Length, MaterialValue, Parameter, plugin
class Own(ContactModel):
    '''F = E d.'''
    parameters = (Parameter("elasticity", "E", "Pa", "modulus", role="elastic", start=1e5),
                  Parameter({second!r}, "B", "N*s/m", "damping", role="viscous", start=10.0))
    def force(self, depth, rate, theta, memory=()):
        return theta[0] * 0.01 * depth + theta[1] * rate
    def material(self, theta):
        return (MaterialValue("viscosity", theta[1], {gradient}),)
@plugin
def palpate_models():
    return {{"own": Own}}
"""
FILTER = """
import numpy as np
from palpate import Belief, Estimator, Length, plugin, track_by_step
class Own(Estimator):
    '''A filter of my own.'''
    surface: Length = {default}
    def start(self, problem):
        {start}
        def step(moment):
            {step}
            return Belief(np.array([1e5, 300.0]), np.array([1e3, 10.0]), 0.003, 1e-4, 1.0)
        return track_by_step(2, step)
@plugin
def palpate_estimators():
    return {{"own-filter": Own}}
"""
SHORT = ("--set", "trajectory.press.duration=1 s")


def own_filter(start="pass", step="pass", default="0.0"):
    return FILTER.format(start=start, step=step, default=default)


@pytest.fixture
def run(palpate, point_pipeline, tmp_path):
    """Run, or check, the example with a plugin file's parts next to the shipped ones."""

    def call(text, *parts, command="run"):
        (point_pipeline.parent / "own.py").write_text(text)
        words = [word for part in (*parts, 'run.plugins=["own.py"]') for word in ("--set", part)]
        out = ("--out", tmp_path / "out") if command == "run" else ()
        return palpate(command, point_pipeline, *words, *SHORT, *out)

    return call


def result_of(folder):
    return json.loads((folder / "result.json").read_text())


def test_a_short_gradient_is_the_models(run, tmp_path):
    text = MODEL.format(second="damping", gradient="(0.0,)")
    done = run(text, 'model.own.type="own"', 'run.tracks=["dr/kinematic", "own/kinematic"]')
    assert done.returncode == 1
    assert "model 'own' of plugin " in done.stderr
    assert "material: the gradient of viscosity has 1 numbers for 2 parameters" in done.stderr
    assert "estimator" not in done.stderr.splitlines()[-1].partition("failed")[0].rpartition(":")[2]
    tracks = result_of(tmp_path / "out")["tracks"]
    assert tracks["dr/kinematic"]["parameters"]["elasticity"]["value"] > 0


@pytest.mark.parametrize("step", ["raise ValueError('no')", "exit(3)"])
def test_a_track_that_fails_makes_the_exit_code_and_the_others_have_results(run, tmp_path, step):
    done = run(own_filter(step=step), 'estimator.own.type="own-filter"', 'run.tracks=["dr/kinematic", "dr/own"]')
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith("palpate: dr/own: estimator 'own-filter' of plugin ")
    assert f"{'SystemExit: 3' if 'exit' in step else 'ValueError: no'} (own.py, line 10, in step)" in last
    assert result_of(tmp_path / "out")["tracks"]["dr/kinematic"]["parameters"]["elasticity"]["value"] > 0


def test_exit_in_the_start_of_a_filter_is_a_failure_of_it(run):
    done = run(own_filter(start="exit(3)"), 'estimator.own.type="own-filter"', command="check")
    assert done.returncode == 2
    assert "failed: SystemExit: 3 (own.py, line 8, in start)" in done.stderr


TIP = """
from palpate import Command, Indenter, plugin
class Own(Indenter):
    '''A tip of my own.'''
    def contact_radius(self, depth):
        exit(3)
def end() -> None:
    exit(4)
@plugin
def palpate_indenters():
    return {"own": Own}
@plugin
def palpate_commands():
    return {"own-end": Command(end, "End.")}
"""


def test_exit_in_a_tip_is_a_failure_of_it_and_in_a_command_its_end(run, palpate, tmp_path):
    done = run(TIP, 'indenter.tip={type="own"}', command="check")
    assert done.returncode == 2
    assert "own.py failed: SystemExit: 3 (" in done.stderr
    assert palpate("--plugin", tmp_path / "own.py", "own-end").returncode == 4


def test_parameters_of_another_kind_are_a_sentence(run):
    text = MODEL.format(second="damping", gradient="(0.0,)")
    for wrong, complaint in (
        (text.replace('"elastic"', '"elastik"'), "parameter 'elasticity': the role is 'elastic', 'viscous' or None"),
        (text.replace('"Pa"', "None"), "parameter 'elasticity': the unit is a text such as 'Pa', not None"),
        (text.replace("parameters = (", "parameters = None and ("), "Own.parameters is not a tuple of Parameter: None"),
        (text.replace("parameters = (", "_others = ("), "(Own), which does not define parameters"),
    ):
        done = run(wrong, 'model.own.type="own"', command="check")
        assert done.returncode == 2
        assert complaint in done.stderr
        assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("import palpate\n1 / 0\n", "ZeroDivisionError: division by zero (own.py, line 2)"),
        ("import palpate\n\nexit(3)\n", "SystemExit: 3 (own.py, line 3)"),
        ("import nothing_of_the_kind\n", "(own.py, line 1)"),
        ("def (\n", "own.py, line 1"),
    ],
)
def test_an_import_error_has_its_line(run, text, place):
    done = run(text, command="check")
    assert done.returncode == 2
    assert place in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("text", "parts", "complaint"),
    [
        (
            MODEL.format(second="elasticity", gradient="(0.0, 1.0)"),
            ['model.own.type="own"'],
            "two parameters of one name",
        ),
        (
            own_filter(default='"5 N"'),
            ['estimator.own.type="own-filter"'],
            "the default '5 N' of surface is wrong: '5 N' is a force, not a length",
        ),
        (
            own_filter(default='"5 mm"'),
            ['estimator.own.type="own-filter"'],
            "the default '5 mm' of surface is a text; write 0.005, in m",
        ),
        ("", ['trajectory.other={type="point", bias="4 mm"}'], "one [trajectory.*] table, not 2"),
    ],
)
def test_what_check_finds(run, text, parts, complaint):
    done = run(text or own_filter(), *parts, command="check")
    assert done.returncode == 2
    assert complaint in done.stderr


def test_the_truth_is_that_of_the_device_that_is_read(palpate, point_pipeline, tmp_path):
    other = 'device.other={type="sim", specimen={model="dr", elasticity="50 kPa", viscosity="100 Pa*s"}}'
    done = palpate("run", point_pipeline, "--out", tmp_path / "out", *SHORT, "--set", other)
    assert done.returncode == 0, done.stderr
    truth = result_of(tmp_path / "out")["truth"]
    assert (truth["elasticity"], truth["viscosity"]) == (112.5e3, 362.0)


DEVICE = """
from palpate import Device, plugin
class Own(Device):
    '''A device of my own.'''
    @property
    def streams(self):
        raise KeyError('x')
    def connect(self, seed):
        return None
@plugin
def palpate_devices():
    return {"own": Own}
"""
VALIDATOR = """
from palpate import Estimator, plugin
from pydantic import model_validator
class Own(Estimator):
    '''A filter of my own.'''
    @model_validator(mode="after")
    def check(self):
        BODY
    def start(self, problem):
        return None
@plugin
def palpate_estimators():
    return {"own-filter": Own}
"""


@pytest.mark.parametrize(
    ("text", "part", "complaint"),
    [
        (DEVICE, 'device.own.type="own"', "failed: KeyError: 'x' (own.py, line 7, in streams)"),
        (
            VALIDATOR.replace("BODY", "raise TypeError('x')"),
            'estimator.own.type="own-filter"',
            "[estimator.own]: Own failed: TypeError: x (own.py, line 8, in check)",
        ),
        (
            VALIDATOR.replace("BODY", "pass"),
            'estimator.own.type="own-filter"',
            "[estimator.own]: a validator of Own returns None, not the part itself",
        ),
    ],
)
def test_an_authors_mistake_is_a_sentence(run, text, part, complaint):
    done = run(text, part, command="check")
    assert done.returncode == 2
    assert complaint in done.stderr
    assert "Traceback" not in done.stderr


ANSWERS = """
from contextlib import nullcontext
import numpy as np
from palpate import Batch, Channel, Device, Stream, plugin
class Link:
    def batches(self):
        {batches}
class Own(Device):
    '''A device of my own.'''
    @property
    def streams(self):
        {streams}
    @property
    def provenance(self):
        {provenance}
    @property
    def warnings(self):
        {warnings}
    def connect(self, seed):
        {connect}
@plugin
def palpate_devices():
    return {{"own": Own}}
"""
SOUND = {
    "streams": "return (Stream('', (Channel('fz', 'N'),), None),)",
    "provenance": "return {}",
    "warnings": "return ()",
    "connect": "return nullcontext(Link())",
    "batches": "yield Batch('', np.array([10**9]), np.array([10**9]), np.ones((1, 1)))",
}


@pytest.mark.parametrize(
    ("method", "body", "complaint"),
    [
        ("streams", "return None", "[device.own]: Own.streams returns None, not a tuple of Stream"),
        ("streams", "return Stream('', (Channel('fz', 'N'),), None)", "not a tuple of Stream"),
        ("streams", "return (Stream('f', ('fz',), None),)", "the channels of 'f' are ('fz',), not Channel"),
        ("connect", "return None", "device own: Own.connect returns None, not a context"),
        ("connect", "return nullcontext(None)", "device own: Own.connect gives None, which is not a link"),
        ("batches", "return None", "device own: Link.batches returns None, not an iterator of Batch"),
        ("batches", "yield 3.0", "device own sends 3.0, not a Batch"),
        ("provenance", "return None", "device own: Own.provenance is None, not a mapping"),
    ],
)
def test_what_a_device_answers_is_a_sentence(run, method, body, complaint):
    done = run(ANSWERS.format(**SOUND | {method: body}), 'device.own.type="own"')
    assert done.returncode == 2
    assert complaint in done.stderr
    assert "Traceback" not in done.stderr


def test_a_sound_device_next_to_the_rig_is_recorded(run, tmp_path):
    done = run(ANSWERS.format(**SOUND), 'device.own.type="own"')
    assert done.returncode == 0, done.stderr
    assert result_of(tmp_path / "out")["streams"]["own"]["samples"] == 1


def test_warnings_that_are_none_are_a_note(run, tmp_path):
    done = run(ANSWERS.format(**SOUND | {"warnings": "return None"}), 'device.own.type="own"')
    assert done.returncode == 0, done.stderr
    tracks = result_of(tmp_path / "out")["tracks"].values()
    messages = [flag["message"] for track in tracks for flag in track["flags"]]
    assert "Own.warnings is None, not a tuple of sentences" in messages


OFFERS = {
    "sink": """
from palpate import Sink, plugin
class Own(Sink):
    '''A sink of my own.'''
    def open(self, run):
        return None
@plugin
def palpate_sinks():
    return {"own": Own}
""",
    "recorder": """
from palpate import Recorder, plugin
@plugin
def palpate_offers():
    return {"recorder": {"own": Recorder(lambda *facts: None)}}
""",
    "display": """
from palpate import Display, plugin
@plugin
def palpate_offers():
    return {"display": {"own": Display(lambda pipeline: None)}}
""",
}


@pytest.mark.parametrize(
    ("kind", "complaint"), [("sink", "sink own: Own.open"), ("recorder", "recorder own"), ("display", "display own")]
)
def test_what_is_opened_is_a_context(run, kind, complaint):
    done = run(OFFERS[kind], *(['sink.own.type="own"'] if kind == "sink" else []))
    assert done.returncode == 2
    assert f"{complaint} returns None, not a context" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_finding_and_a_section_of_another_kind(run, tmp_path):
    text = """
from palpate import Diagnosis, ReportSection, plugin
@plugin
def palpate_diagnoses():
    return {"own": Diagnosis(lambda evidence: {track.name: 3 for track in evidence})}
@plugin
def palpate_report_sections():
    return {"own": ReportSection(lambda result: [7])}
"""
    done = run(text)
    assert done.returncode == 0, done.stderr
    (track, *_) = result_of(tmp_path / "out")["tracks"].values()
    messages = [flag["message"] for flag in track["flags"] if flag["code"] == "diagnosis-failed"]
    assert "is 3, not Diagnosed" in messages[0]
    assert "7" in done.stdout.split()
