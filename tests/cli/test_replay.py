"""``palpate replay``: the run of a log, by the pipeline that the log carries."""

import json
import shutil
import subprocess
import sys

import pytest
from palpate_kit.runs.run_folder import RunFolder, pipeline_among

SHORT = [
    "--set",
    "trajectory.press.duration=6 s",
    "--set",
    "indenter.tip.radius=2.5 mm",
    "--set",
    "estimator.ekf.force_std=0.04 N",
    "--set",
    'run.tracks=["*/ekf"]',
]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, root):
    """A run with another tip than the file's, by --set, and its log."""
    from palpate_engine.config import load_pipeline
    from palpate_engine.pipeline import run_pipeline

    folder = tmp_path_factory.mktemp("recorded")
    file = shutil.copy(root / "pipelines" / "filters.toml", folder / "point.toml")
    return run_pipeline(load_pipeline(type(root)(file), SHORT[1::2]), folder / "run").folder


def tracks(folder):
    found = json.loads((folder / "result.json").read_text())["tracks"]
    for track in found.values():
        del track["seconds_per_sample"]
    return found


LOADED = """
import sys
from palpate_engine.cli import call

call(["replay", *sys.argv[1:]])
settings = {"palpate_arms", "palpate_arms.arm_device", "palpate_arms.arm_settings"}
names = {name for name in sys.modules if name.startswith(("palpate_arms", "palpate_engine.pipeline.live"))}
print("loaded:", *(names - settings))
"""


def test_a_replay_loads_no_arm_and_nothing_of_a_live_run(recorded, tmp_path):
    command = [sys.executable, "-c", LOADED, recorded / "log.mcap", "--out", tmp_path / "again"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout.rpartition("loaded:")[2].split() == []


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize("source", ["run", "run/log.mcap"])
def test_the_same_bits_from_a_run_folder_and_from_its_log(recorded, palpate, tmp_path, source):
    done = palpate("replay", recorded.parent / source, "--out", tmp_path / "again")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "again" / "estimates.csv").read_bytes() == (recorded / "estimates.csv").read_bytes()
    assert tracks(tmp_path / "again") == tracks(recorded)


@pytest.mark.slow
def test_the_one_pipeline_of_the_folder_reproduces_the_run(palpate, point_pipeline, tmp_path):
    """With what was set on the command line, and with the tables of analyses that judge the run."""
    with point_pipeline.open("a", encoding="utf-8") as file:
        file.write('\n[model.exact]\ntype = "dimensionality-reduction"\nindenter = "tip"\npoisson = 0.45\n')
        file.write('\n[choice]\ncandidates = ["dr", "exact"]\n')
    done = palpate("run", point_pipeline, *SHORT, "--out", tmp_path / "run")
    assert done.returncode == 0, done.stderr
    done = palpate("run", tmp_path / "run" / "pipeline.toml", "--out", tmp_path / "again")
    assert done.returncode == 0, done.stderr
    assert tracks(tmp_path / "again") == tracks(tmp_path / "run")
    assert "model-choice" in json.dumps(tracks(tmp_path / "run"))
    assert (tmp_path / "again" / "pipeline.toml").read_text() == (tmp_path / "run" / "pipeline.toml").read_text()
    assert (tmp_path / "run" / "given.toml").read_text() == point_pipeline.read_text()


def test_a_folder_and_a_log_of_an_older_palpate(recorded, palpate, tmp_path):
    """Their pipeline as run stands in resolved.toml, and pipeline.toml beside it lacks what was set."""
    old = shutil.copytree(recorded, tmp_path / "old")
    (old / "pipeline.toml").rename(old / "resolved.toml")
    (old / "given.toml").rename(old / "pipeline.toml")
    done = palpate("replay", old, "--out", tmp_path / "again")
    assert done.returncode == 0, done.stderr
    assert tracks(tmp_path / "again") == tracks(recorded)
    assert pipeline_among({"pipeline.toml": "as given", "resolved.toml": "as run"}) == "resolved.toml"
    assert RunFolder(old).given == old / "pipeline.toml"


def test_a_log_alone_is_enough(recorded, palpate, tmp_path):
    log = shutil.copy(recorded / "log.mcap", tmp_path)
    done = palpate("replay", log, "--out", tmp_path / "again")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "again" / "estimates.csv").read_bytes() == (recorded / "estimates.csv").read_bytes()


@pytest.mark.slow
def test_one_more_estimator_and_other_settings(recorded, palpate, tmp_path):
    done = palpate("replay", recorded, "--add-estimator", "kinematic-ekf", "--out", tmp_path / "more")
    assert done.returncode == 0, done.stderr
    assert set(tracks(tmp_path / "more")) == {"dr/ekf", "dr/kinematic-ekf"}
    beside, alone = tracks(tmp_path / "more")["dr/ekf"], tracks(recorded)["dr/ekf"]
    # Only several tracks are compared.
    assert beside.pop("comparison") is not None
    assert alone.get("comparison") is None
    alone.pop("comparison", None)
    assert beside == alone
    done = palpate("replay", recorded, "--set", "estimator.ekf.force_std=0.1 N", "--out", tmp_path / "other")
    assert done.returncode == 0, done.stderr
    assert tracks(tmp_path / "other")["dr/ekf"] != tracks(recorded)["dr/ekf"]


def test_a_log_is_no_pipeline_file(recorded, palpate):
    done = palpate("run", recorded / "log.mcap")
    assert done.returncode == 2
    assert "palpate replay" in done.stderr
    done = palpate("run", recorded)
    assert done.returncode == 2
    assert "palpate replay" in done.stderr


@pytest.mark.slow
def test_a_plugin_file_of_the_recording_is_needed_and_must_be_the_same(palpate, point_pipeline, tmp_path):
    own = tmp_path / "my_tip.py"
    own.write_text(
        "from palpate import Indenter, Length, plugin\n"
        "class Mine(Indenter):\n"
        "    radius: Length\n"
        "    def contact_radius(self, depth):\n"
        "        return (self.radius * depth) ** 0.5\n"
        "@plugin\ndef palpate_indenters():\n    return {'mine': Mine}\n"
    )
    sets = ["--set", 'run.plugins=["my_tip.py"]', "--set", 'indenter.tip={type="mine", radius="5 mm"}']
    short = ["--set", "trajectory.press.duration=1 s", "--set", 'run.tracks=["*/ekf"]']
    done = palpate("run", point_pipeline, "--out", tmp_path / "run", *sets, *short)
    assert done.returncode == 0, done.stderr
    again = palpate("replay", tmp_path / "run", "--out", tmp_path / "again")
    assert again.returncode == 0, again.stderr
    own.write_text(own.read_text() + "# changed\n")
    other = palpate("replay", tmp_path / "run", "--out", tmp_path / "other")
    assert other.returncode == 2
    assert "another version of the plugin file" in other.stderr
    own.unlink()
    gone = palpate("replay", tmp_path / "run", "--out", tmp_path / "gone")
    assert gone.returncode == 2
    assert "is not on this machine" in gone.stderr
    assert not (tmp_path / "gone").exists()


def test_a_foreign_log_carries_no_pipeline(palpate, root):
    done = palpate("replay", root / "tests" / "logs" / "corpus" / "commas.csv")
    assert done.returncode == 2
    assert "carries no pipeline" in done.stderr


def flagged(folder):
    """What every track assumes by the keys of its pipeline; empty where there is none."""
    (said,) = {
        " ".join(one["message"] for one in track["conditions"] if one.get("code") == "assumed")
        for track in tracks(folder).values()
    }
    return said


@pytest.mark.slow
def test_a_suggestion_begins_from_what_the_log_carries(recorded, palpate, tmp_path):
    done = palpate("info", recorded / "log.mcap", "--suggest", "--out", tmp_path / "own.toml")
    assert done.returncode == 0, done.stderr
    assert "those of its run" in done.stderr
    done = palpate("run", tmp_path / "own.toml", "--out", tmp_path / "again")
    assert done.returncode == 0, done.stderr
    assert tracks(tmp_path / "again") == tracks(recorded)


@pytest.mark.slow
def test_repeat_takes_logs(recorded, palpate, tmp_path, root):
    logs = [shutil.copy(recorded / "log.mcap", tmp_path / f"{name}.mcap") for name in ("one", "two")]
    done = palpate("repeat", *logs, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "indenter.tip.radius = 2.5 mm" in done.stderr
    values = json.loads(done.stdout)["groups"]["runs"]["values"]
    assert values == 2 * [tracks(recorded)["dr/ekf"]["parameters"]["elasticity"]["value"]]
    done = palpate("repeat", root / "tests" / "logs" / "corpus" / "commas.csv")
    assert done.returncode == 2
    assert "carries no pipeline" in done.stderr


def test_an_assumption_belongs_to_its_model_or_to_all(root):
    from palpate_engine import TrackResult, UncertainValue
    from palpate_engine.config import load_pipeline
    from palpate_engine.pipeline.run_result import _assumed_conditions

    kinds = ["model.kv.type=kelvin-voigt", 'run.assumed=["model.dr.poisson", "alignment.tip_mass"]']
    pipeline = load_pipeline(root / "pipelines" / "filters.toml", kinds)
    nothing = UncertainValue(0.0, 0.0, "m")
    tracks = [TrackResult(model, "ekf", 1, {}, nothing, 0.0, 1.0, (), 0.0) for model in ("dr", "kv")]
    said = {track.model: [one.fact for one in _assumed_conditions(pipeline, track)] for track in tracks}
    assert said == {"dr": ["model.dr.poisson", "alignment.tip_mass"], "kv": ["alignment.tip_mass"]}


@pytest.mark.slow
def test_what_is_assumed_of_one_model_is_said_of_its_tracks_alone(recorded, palpate, tmp_path):
    added = ["--add-model", "standard-linear-solid", "--tracks", "*/ekf"]
    done = palpate("replay", recorded / "log.mcap", *added, "--set", 'run.assumed=["model.standard-linear-solid.*"]')
    assert done.returncode == 0, done.stderr
    (folder,) = {path.parent for path in tmp_path.glob("runs/*/result.json")}
    said = {
        name: [one["message"] for one in track["conditions"] if one.get("code") == "assumed"]
        for name, track in tracks(folder).items()
    }
    assert said["dr/ekf"] == []
    (message,) = said["standard-linear-solid/ekf"]
    assert "model.standard-linear-solid.poisson" in message
    assert tracks(folder)["dr/ekf"]["verdict"] == tracks(recorded)["dr/ekf"]["verdict"]


def test_another_tip_reaches_the_models_on_it(recorded, palpate, tmp_path):
    """E of a sphere goes as 1/sqrt(R); the pipeline that a log carries has the tip in each model."""
    change = "indenter.tip.radius=10 mm"
    done = palpate("replay", recorded, "--tracks", "dr/ekf", "--set", change, "--out", tmp_path / "again")
    assert done.returncode == 0, done.stderr
    before, after = (tracks(folder)["dr/ekf"]["parameters"]["elasticity"] for folder in (recorded, tmp_path / "again"))
    assert after["value"] == pytest.approx(before["value"] / 2, rel=0.05)
