"""Every command that prints a table prints it as JSON, and nothing else on standard output."""

import json
import shutil

import pytest
from palpate_engine import load_pipeline, run_pipeline

LINE = [
    'trajectory.sweep.start=["0 mm", "-22 mm"]',
    'trajectory.sweep.end=["0 mm", "-8 mm"]',
    "trajectory.sweep.settle=2 s",
]
SHORT = ["trajectory.press.duration=2 s"]


@pytest.fixture(scope="module")
def folder(root, tmp_path_factory):
    """A pipeline of a point, a run of it with its log, and a run along a line."""
    made = tmp_path_factory.mktemp("json")
    for name, copy in (("filters", "point"), ("sweep", "sweep"), ("guided", "guided")):
        shutil.copy(root / "pipelines" / f"{name}.toml", made / f"{copy}.toml")
    run_pipeline(load_pipeline(made / "point.toml", [*SHORT, 'run.tracks=["dr/ekf"]']), made / "run")
    run_pipeline(load_pipeline(made / "sweep.toml", [*LINE, 'run.tracks=["dr/kinematic"]']), made / "line")
    settings = '[sweep]\n"run.seed" = [1, 2]\n'
    (made / "seeds.toml").write_text((made / "point.toml").read_text() + settings)
    return made


def options(*settings):
    return [word for setting in settings for word in ("--set", setting)]


CASES = {
    "list": (["list"], lambda found: found["model"]["dimensionality-reduction"]["plugin"]),
    "describe a part": (["describe", "sphere"], lambda found: found["parts"][0]["keys"]["radius"]["unit"] == "m"),
    "describe a flag": (["describe", "diverged"], lambda found: found["flags"][0]["severity"] == "invalid"),
    "describe a table": (["describe", "run"], lambda found: found["parts"][0]["keys"]["seed"]["default"] == 0),
    "check": (["check", "point.toml"], lambda found: found["tracks"] == ["dr/ekf", "dr/kinematic"]),
    "check in full": (["check", "point.toml", "--resolved"], lambda found: found["resolved"]["run"]["seed"] == 1),
    "info": (["info"], lambda found: found["libraries"]["numpy"] and found["plugins"]),
    "info of a log": (["info", "run/log.mcap"], lambda found: found["topics"][0]["messages"] > 100),
    "info suggests": (["info", "run/log.mcap", "--suggest"], lambda found: "[alignment]" in found["pipeline"]),
    "plan": (["check", "motion", "point.toml"], lambda found: found["press"]["duration"] > 10),
    "doctor": (["doctor", "point.toml"], lambda found: found["findings"][0]["verdict"] == "note"),
    "map": (["map", "line"], lambda found: found["kind"] == "sweep" and len(found["files"]) == 2),
    "curves": (["map", "curves", "line"], lambda found: len(found["dr/kinematic"]["along"]) > 10),
    "search": (
        ["map", "search", "line", "--area", "-4 mm, 4 mm, -24 mm, -6 mm"],
        lambda found: found["rounds"][0][0]["place"] and found["stopped"] is None,
    ),
    "lumps": (["map", "lumps", "line"], lambda found: found["track"] == "dr/kinematic"),
    "run": (["run", "point.toml", *options(*SHORT)], lambda found: found["tracks"]["dr/ekf"]["verdict"]),
    "sweep": (
        ["sweep", "seeds.toml", "--jobs", "1", *options(*SHORT, 'run.tracks=["dr/ekf"]')],
        lambda found: [row["run.seed"] for row in found["rows"]] == [1, 2],
    ),
    "budget": (["report", "budget", "run"], lambda found: found),
    "calibrate": (["calibrate", "guided.toml", "--yes"], lambda found: 0.1 < found["values"]["mass"]["value"] < 0.3),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_the_output_is_one_document(palpate, folder, case):
    arguments, holds = CASES[case]
    done = palpate(*arguments, "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    assert holds(found)


def test_a_mistake_prints_no_document(palpate, folder):
    for arguments in (["check", "nowhere.toml"], ["info", "nowhere.mcap"], ["describe", "spher"], ["map", "nowhere"]):
        done = palpate(*arguments, "--json", cwd=folder)
        assert done.returncode == 2
        assert done.stdout == ""
        assert "nowhere" in done.stderr or "did you mean" in done.stderr
