"""Pipelines of older versions are read by their old names, and said; what is newer is refused by name."""

import tomllib

import pytest
from palpate.errors import ConfigurationError
from palpate_engine.config import Source, build_pipeline, load_pipeline, resolved_text

PLUGIN = """
from palpate import Estimator, Migration, Settings, Speed, plugin
from pydantic import Field


class Inner(Settings):
    limit: Speed = Field(default=1.0, description="a limit")


class Newer(Estimator):
    '''A filter whose keys were renamed.'''

    inner: Inner = Field(default=Inner(), description="a table")
    rounds: int = Field(default=1, description="rounds")

    def start(self, problem):
        '''Never.'''


@plugin
def palpate_estimators():
    return {"newer": Newer}


@plugin
def palpate_migrations():
    return [
        Migration("0.2", "estimator", "newer", keys={"theta": "inner.limit"}),
        Migration("0.2", "estimator", "twice", becomes="newer", implied={"rounds": 2}),
    ]
"""
FILTERS = '\n[estimator.a]\ntype = "newer"\ntheta = "2 mm/s"\n[estimator.b]\ntype = "twice"\n'


@pytest.fixture
def written(point_pipeline):
    def write(more="", version=None):
        (point_pipeline.parent / "own.py").write_text(PLUGIN)
        text = point_pipeline.read_text().replace("[run]\n", '[run]\nplugins = ["own.py"]\n', 1)
        point_pipeline.write_text((f'palpate = "{version}"\n' if version else "") + text + more)
        return point_pipeline

    return write


@pytest.mark.parametrize("version", [None, "0.1", "0.1.7"])
def test_what_was_renamed_is_read_and_said(written, version):
    pipeline = load_pipeline(written(FILTERS, version))
    assert pipeline.estimators["a"].inner.limit == pytest.approx(2e-3)
    assert pipeline.estimators["b"].rounds == 2
    said = [str(flag) for flag in pipeline.renamed]
    line = 1 + pipeline.text.splitlines().index('theta = "2 mm/s"')
    assert f"renamed: {pipeline.path}:{line}: [estimator.a] theta is called inner.limit since palpate 0.2" in said
    assert any("type twice is newer with rounds = 2" in text for text in said)


def test_overrides_may_use_the_old_names(written):
    pipeline = load_pipeline(written(FILTERS), ["estimator.a.theta=3 mm/s"])
    assert pipeline.estimators["a"].inner.limit == pytest.approx(3e-3)
    assert str(pipeline.renamed[0]).startswith("renamed: --set estimator.a.theta: [estimator.a] theta is called")


def test_what_is_resolved_states_its_version_and_needs_no_renaming(written):
    pipeline = load_pipeline(written(FILTERS))
    text = resolved_text(pipeline)
    assert tomllib.loads(text)["palpate"] == "0.2"
    again = build_pipeline(Source(text, pipeline.path))
    assert not again.renamed
    assert resolved_text(again) == text


def test_a_file_of_today_has_no_old_names(written):
    """What states today's version is not guessed at: an old key is a mistake in its line."""
    with pytest.raises(ConfigurationError, match=r"\[estimator\.a\]: unknown key 'theta'"):
        load_pipeline(written('\n[estimator.a]\ntype = "newer"\ntheta = "2 mm/s"\n', "0.2"))


def test_old_and_new_name_together_are_a_mistake(written):
    both = '\n[estimator.a]\ntype = "newer"\ntheta = "2 mm/s"\ninner = { limit = "1 mm/s" }\n'
    with pytest.raises(ConfigurationError, match="unknown key 'theta'"):
        load_pipeline(written(both))


@pytest.mark.parametrize(
    ("version", "problem"),
    [
        ("9.3", r'point\.toml:1: written for palpate 9\.3, but this palpate reads up to "0\.2": update it'),
        ("new", r'point\.toml:1: palpate is \'new\'; write a version, such as palpate = "0\.2"'),
    ],
)
def test_another_version_is_refused_by_name(written, version, problem):
    with pytest.raises(ConfigurationError, match=problem):
        load_pipeline(written(version=version))


def test_check_says_what_was_renamed(palpate, written):
    text = written('\n[estimator.b]\ntype = "twice"\n').read_text()
    written().write_text(text.replace('tracks = ["*"]', "").replace("[run]", '[run]\ntracks = ["*/ekf"]', 1))
    done = palpate("check", "point.toml")
    assert done.returncode == 0, done.stderr
    assert "renamed: point.toml:" in done.stderr


RIG = """
[safety]
low = ["-1 m", "-1 m", "-1 m"]
high = ["1 m", "1 m", "1 m"]
force = "20 N"
stop_force = "10 N"
stiffness = "1 kN/m"
"""


@pytest.mark.parametrize("key", ["", "_force", "_noise", "_speed", "_excess"])
def test_the_standstill_of_older_rigs(written, key):
    value = {"": "2 s", "_force": "4 N", "_noise": "0.5 N", "_speed": "2 mm/s", "_excess": "2"}[key]
    pipeline = load_pipeline(written(f"{RIG}rest{key} = {value if key == '_excess' else repr(value)}\n"))
    found = getattr(pipeline.safety, f"standstill{key}")
    assert found == pytest.approx({"": 2.0, "_force": 4.0, "_noise": 0.5, "_speed": 2e-3, "_excess": 2.0}[key])
    assert f"[safety] rest{key} is called standstill{key} since palpate 0.2" in str(pipeline.renamed[0])


def test_the_standstill_of_older_motions(written):
    path = written()
    path.write_text(path.read_text().replace("[trajectory.press]", "[trajectory.press]\nrest = '3 s'", 1))
    pipeline = load_pipeline(path)
    assert pipeline.trajectories["press"].standstill == pytest.approx(3.0)
    line = 1 + next(i for i, text in enumerate(path.read_text().splitlines()) if text.startswith("rest = '3 s'"))
    assert str(pipeline.renamed[0]).startswith(f"renamed: {path}:{line}: [trajectory.press] rest is called standstill")


MOVED = """
[trajectory.lines]
type = "moved"
of.type = "line-sweep"
of.end = ["9 mm", "0 mm"]
by = ["1 mm", "0 mm"]
of.press = { bias = "3 mm", rest = "2 s" }
[calibration.rest]
trajectory = { type = "shake", amplitude = "5 mm", rest = "1 s" }
"""


def test_older_motions_within_motions_and_steps(written):
    """Wherever a part stands: in another one, in a table of an analysis; the lines go with them."""
    path = written(MOVED)
    with pytest.raises(ConfigurationError) as told:
        load_pipeline(path, ["calibration.rest.trajectory.amplitude=1 N"])
    assert "--set calibration.standstill.trajectory.amplitude" in str(told.value)
    assert "unknown key" not in str(told.value)
    pipeline = load_pipeline(path)
    assert pipeline.trajectories["lines"].of.press.standstill == pytest.approx(2.0)
    assert pipeline.tables["calibration"].standstill.trajectory.standstill == pytest.approx(1.0)
