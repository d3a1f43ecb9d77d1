"""A run folder with a damaged file: one sentence with file and key, whichever command reads it."""

import json
import shutil
from pathlib import Path

import pytest
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline

ROOT = Path(__file__).parents[2]
# What reads a result and needs it. `watch` shows one without a log; the others replay the log, which has the pipeline.
NEED_RESULT = [
    "report RUN -o page.html",
    "report RUN OTHER -o page.html",
    "report budget RUN",
    "plot RUN estimates",
    "map RUN",
    "map lumps RUN",
    "map curves RUN OTHER",
    "map compare --baseline OTHER --suspect RUN",
    "repeat RUN --track dr/kinematic",
    "repeat review RUN --track dr/kinematic",
    "replay watch RUN",
]
NEED_WHOLE_RESULT = ["report budget RUN", "repeat RUN", "repeat review RUN", "replay watch RUN"]
NEED_ESTIMATES = [
    "plot RUN estimates",
    "map RUN",
    "map lumps RUN",
    "map curves RUN OTHER",
    "replay watch RUN",
    "run resume RUN",
]
NEED_PIPELINE = ["run resume RUN", "map search RUN"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run that nobody damages."""
    overrides = ["trajectory.press.duration=1 s", 'run.tracks=["dr/kinematic"]']
    folder = tmp_path_factory.mktemp("whole") / "run"
    run_pipeline(load_pipeline(ROOT / "pipelines" / "filters.toml", overrides), folder)
    return folder


@pytest.fixture
def refused(palpate, whole, tmp_path):
    """The sentence with which a command refuses the run after a damage to one of its files."""

    def call(command, file, damage):
        for name in ("run", "other"):
            shutil.copytree(whole, tmp_path / name, ignore=shutil.ignore_patterns("*.mcap"))
        path = tmp_path / "run" / file
        path.write_text(damage(path.read_text()))
        words = command.replace("RUN", "run").replace("OTHER", "other").split()
        done = palpate(*words)
        assert done.returncode == 2, done.stderr
        assert "Traceback" not in done.stderr
        assert done.stderr.startswith(f"palpate: run/{file}:"), done.stderr
        assert file == "pipeline.toml" or done.stderr.count("\n") == 1  # all mistakes of a pipeline are listed
        return done.stderr

    return call


def edited(change):
    """A damage that changes the tables of a document."""

    def damage(text):
        document = json.loads(text)
        change(document)
        return json.dumps(document)

    return damage


TRACK = "dr/kinematic"
RESULTS = {
    'tracks.dr/kinematic.surface.value must be a valid number, not "high"': lambda d: d["tracks"]["dr/kinematic"][
        "surface"
    ].update(value="high"),
    "run.tare is missing (and 1 more)": lambda d: (d["run"].pop("tare"), d["tracks"]["dr/kinematic"].pop("flags")),
    "tracks.dr/kinematic must be a table, not null": lambda d: d["tracks"].update({"dr/kinematic": None}),
    "streams must be a valid dictionary, not [1, 2]": lambda d: d.update(streams=[1, 2]),
}


@pytest.mark.parametrize("command", NEED_RESULT)
@pytest.mark.parametrize("words", RESULTS)
def test_a_key_of_a_result(refused, command, words):
    assert words in refused(command, "result.json", edited(RESULTS[words]))


@pytest.mark.parametrize("command", NEED_WHOLE_RESULT)
def test_a_result_that_is_cut(refused, command):
    """Others show what there is, as of a run that is still going on."""
    said = refused(command, "result.json", lambda text: text[: len(text) // 2])
    assert "run/result.json: is not a result of palpate: " in said


@pytest.mark.parametrize("command", NEED_ESTIMATES)
@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (
            lambda text: text.replace("dr/kinematic:surface,", "dr/kinematic:height,"),
            "its column dr/kinematic:surface is missing",
        ),
        (lambda text: text.replace("x_m", "y_m", 1), "its column x_m is missing"),
        (lambda text: text.replace("\n0", "\nabc", 1), "is not a table of numbers: could not convert string 'abc"),
    ],
)
def test_a_table_of_estimates(refused, command, damage, words):
    assert words in refused(command, "estimates.csv", damage)


@pytest.mark.parametrize("command", NEED_PIPELINE)
@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda text: f"{text[: len(text) // 2]}\n[[[\n", "not TOML"),
        (lambda text: text.replace("[alignment]", "[alignement]"), "[alignement]: unknown table"),
        (lambda text: text.replace("poisson = ", "poisson = true  # "), "[model.dr] poisson"),
    ],
)
def test_a_pipeline(refused, command, damage, words):
    assert words in refused(command, "pipeline.toml", damage)
