"""Parts of strangers that raise, answer nonsense, or are misspelt: named, with plugin, file and line."""

import json

import pytest

FILTER = """
import numpy as np
from palpate import Belief, Estimates, Estimator, plugin, track_by_step


class Broken(Estimator):
    '''Begins well.'''

    def start(self, problem):
        '''A tracker.'''
        count = 0

        def step(moment):
            nonlocal count
            count += 1
            if count > 600:
                {body}
            return Belief(np.array([1e5, 300.0]), np.array([1e3, 3.0]), 4e-3, 1e-5, moment.force)

        return track_by_step(2, step)


@plugin
def palpate_estimators():
    return {{"broken": Broken}}
"""

MODEL = """
import numpy as np
from palpate import ContactModel, Indenter, Parameter, plugin
from pydantic import Field


class Own(ContactModel):
    '''F = E d^1.5.'''

    parameters = (Parameter("elasticity", "E", "Pa", "of the material", role="elastic"),)
    indenter: Indenter = Field(description="the tip")

    {signature}
        {force}

    {more}


@plugin
def palpate_models():
    return {{"own": Own}}
"""
SIGNATURE = "def force(self, depth, rate, theta, memory=()):"
FORCE = "return theta[0] * self.indenter.profile_area(depth)"


@pytest.fixture
def with_plugin(point_pipeline):
    """The example, short, with a plugin and more tables."""

    def make(plugin, tables, replaced=("", "")):
        (point_pipeline.parent / "own.py").write_text(plugin)
        text = point_pipeline.read_text().replace("[run]\nname", '[run]\nplugins = ["own.py"]\nname', 1)
        text = text.replace('duration = "10 s"', 'duration = "2 s"').replace(*replaced)
        point_pipeline.write_text(text + tables)
        return point_pipeline

    return make


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "code", "words"),
    [
        ("raise KeyError('lost')", "failed", ["estimator 'broken' of plugin", "own.py, line 17, in step", "KeyError"]),
        ("return 3", "failed", ["AttributeError", "between"]),
        ("return Belief(np.zeros(3), np.zeros(3), 0, 0, 0)", "failed", ["ValueError"]),
        ("return Belief(np.full(2, np.nan), np.ones(2), 4e-3, 1e-5, 0.0)", "diverged", ["finite"]),
    ],
)
def test_a_filter_that_fails_ends_its_track_alone(palpate, with_plugin, tmp_path, body, code, words):
    path = with_plugin(FILTER.format(body=body), '\n[estimator.own]\ntype = "broken"\n')
    done = palpate("run", path, "--out", tmp_path / "out")
    assert done.returncode == (1 if code == "failed" else 0), done.stderr
    tracks = json.loads((tmp_path / "out" / "result.json").read_text())["tracks"]
    flags = {flag["code"]: flag["message"] for flag in tracks["dr/own"]["flags"]}
    assert tracks["dr/own"]["verdict"] == "invalid"
    assert tracks["dr/own"]["parameters"]["elasticity"]["value"] is None
    assert all(word in flags[code] for word in words), flags
    other = tracks["dr/ekf"]["parameters"]["elasticity"]  # of a run too short to determine it
    assert (other["estimate"] if other["value"] is None else other["value"]) > 0
    assert "failed" not in {flag["code"] for flag in tracks["dr/ekf"]["flags"]}
    header, *rows = (tmp_path / "out" / "estimates.csv").read_text().splitlines()
    assert "dr/own:elasticity" in header
    assert len(rows) > 100


@pytest.mark.gate
@pytest.mark.slow
def test_a_model_that_cannot_say_what_it_found_ends_its_own_tracks(palpate, with_plugin, tmp_path):
    more = "def material(self, theta):\n        return 1 / 0"
    own = '\n[model.own]\ntype = "own"\nindenter = "tip"\n'
    path = with_plugin(MODEL.format(signature=SIGNATURE, force=FORCE, more=more), own)
    done = palpate("run", path, "--out", tmp_path / "out")
    assert done.returncode == 1, done.stderr
    tracks = json.loads((tmp_path / "out" / "result.json").read_text())["tracks"]
    flags = {flag["code"]: flag["message"] for flag in tracks["own/ekf"]["flags"]}
    assert "model 'own' of plugin" in flags["failed"]
    assert "in material" in flags["failed"]
    assert tracks["dr/ekf"]["verdict"] != "invalid"


def test_an_estimator_that_cannot_start_is_named(palpate, with_plugin):
    plugin = FILTER.format(body="pass").replace("count = 0\n", "count = {}['nothing']\n", 1)
    done = palpate("run", with_plugin(plugin, '\n[estimator.own]\ntype = "broken"\n'))
    assert done.returncode == 2
    assert "estimator 'broken' of plugin" in done.stderr
    assert "own.py, line 11, in start" in done.stderr


@pytest.mark.parametrize(
    ("signature", "force", "words"),
    [
        ("def force(self, depth, theta):", FORCE, "takes (depth, rate, theta, memory)"),
        (SIGNATURE, "return float('nan') * depth", "is nan at depth"),
        (SIGNATURE, "return [depth, depth]", "Own.force"),
        (SIGNATURE, "return theta[0] * (1e-3 - depth)", "it falls beyond a depth of"),
        (SIGNATURE, "return 1 / 0", "ZeroDivisionError"),
    ],
)
def test_a_wrong_model_is_found_before_anything_runs(palpate, with_plugin, signature, force, words):
    plugin = MODEL.format(signature=signature, force=force, more="")
    done = palpate("check", with_plugin(plugin, '\n[model.own]\ntype = "own"\nindenter = "tip"\n'))
    assert done.returncode == 2
    assert "own.py: model 'own': Own.force" in done.stderr
    assert words in done.stderr


def test_a_model_that_sticks_may_pull(palpate, with_plugin):
    plugin = MODEL.format(signature=SIGNATURE, force=f"{FORCE} - 1e-3 * depth", more="adhesive = True")
    file = with_plugin(plugin, '\n[model.own]\ntype = "own"\nindenter = "tip"\n')
    done = palpate("check", file)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("plugin", "words"),
    [
        (
            "from palpate import plugin\n@plugin\ndef palpate_indenter():\n    return {}\n",
            "palpate_indenter is not a hook; did you mean 'palpate_indenters'?",
        ),
        ("def palpate_indenters():\n    return {}\n", "palpate_indenters is not marked @palpate.plugin"),
        ("x = 1\n", "offers nothing"),
    ],
)
def test_a_plugin_that_does_nothing_is_named(palpate, with_plugin, plugin, words):
    done = palpate("check", with_plugin(plugin, ""))
    assert done.returncode == 0, done.stderr
    assert "own.py" in done.stderr
    assert words in done.stderr


def test_check_says_which_plugins_it_loaded_from_where(palpate, with_plugin):
    path = with_plugin(FILTER.format(body="pass"), "")
    brief = palpate("check", path).stdout
    assert len(brief.splitlines()) == 2
    assert str(path.parent / "own.py") in brief.partition("with ")[2]
    shown = palpate("check", path, "-v").stdout
    assert f"plugin {path.parent / 'own.py'}" in shown
    assert "palpate_models" in shown


def test_a_first_guess_is_for_the_models_that_have_the_parameter(palpate, with_plugin):
    plugin = MODEL.format(signature=SIGNATURE, force=FORCE, more="")
    own = '\n[model.own]\ntype = "own"\nindenter = "tip"\n'
    guess = ('type = "ekf"\n', 'type = "ekf"\nfirst_guess = { viscosity = "300 Pa*s" }\n')
    done = palpate("check", with_plugin(plugin, own, guess))
    assert done.returncode == 0, done.stderr
    done = palpate("check", with_plugin(plugin, "", ("first_guess = { viscosity", "first_guess = { viscosityy")))
    assert done.returncode == 2
    assert "first guess of viscosityy" in done.stderr
    assert "the model has elasticity, viscosity; own has elasticity" in done.stderr


DEVICE = """
from contextlib import contextmanager

import numpy as np
from palpate import Batch, Channel, Device, Stream, plugin


class Own(Device):
    '''A spring of 300 N/m.'''

    @property
    def streams(self):
        '''Height and force.'''
        return (Stream("swing", (Channel("z", "m"), Channel("f", "N")), 500.0),)

    @contextmanager
    def connect(self, seed):
        '''The link.'''
        yield Link()


class Link:
    '''Goes wrong after a second.'''

    def batches(self):
        '''One for each tenth of a second.'''
        for start in range(0, 1000, 50):
            time = np.arange(start, start + 50) / 500
            depth = 0.002 - 0.003 * np.cos(2 * np.pi * time)
            stamps, name = np.rint(1e9 * time).astype(np.int64), "swing"
            values = np.column_stack([-depth, 300.0 * np.maximum(depth, 0.0)])
            if start == 500:
                {body}
            yield Batch(name, stamps, stamps, values)


@plugin
def palpate_devices():
    return {{"own": Own}}
"""
OF_DEVICE = """
[run]
plugins = ["own.py"]

[device.spring]
type = "own"

[alignment]
tare = "none"
tip_mass = "0 g"
force = {channel = "spring.swing.f", uncertainty = "0.1 ms"}
position = "spring.swing.z"

[model.dr]
type = "dr"
indenter = {type = "sphere", radius = "5 mm"}

[estimator.kinematic]
type = "kinematic-ekf"
"""


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("raise KeyError('lost')", "device spring failed: KeyError: 'lost' (own.py, line 33, in batches)"),
        ("name = 'swung'", "device spring sends a stream 'swung'; did you mean 'swing'?"),
        ("values = values[:, :1]", "sends values of shape (50, 1) in place of (50, 2) in the stream 'swing'"),
    ],
)
def test_a_device_that_goes_wrong_half_way_leaves_what_was_until_then(palpate, tmp_path, body, words):
    (tmp_path / "own.py").write_text(DEVICE.format(body=body))
    (tmp_path / "own.toml").write_text(OF_DEVICE)
    done = palpate("run", tmp_path / "own.toml", "--out", tmp_path / "out")
    assert done.returncode == 1
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    (track,) = json.loads((tmp_path / "out" / "result.json").read_text())["tracks"].values()
    (flag,) = [flag for flag in track["flags"] if flag["code"] == "interrupted"]
    assert words in flag["message"]
