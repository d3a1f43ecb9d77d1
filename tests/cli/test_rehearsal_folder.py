"""A folder of simulated time: no command that starts from it reaches a device, and what it continues is simulated."""

import inspect
import json

import numpy as np
import pytest
from palpate import ConfigurationError, LogError
from palpate.offers import function_of
from palpate.plugin_switch import only_plugins
from palpate.registry import load_commands
from palpate_commands.resume import remaining_pipeline
from palpate_engine.config import load_pipeline, resolved_text
from palpate_engine.pipeline import run_pipeline
from palpate_kit.acquisition.computer import use_host
from palpate_kit.runs.run_folder import RunFolder
from palpate_simulation.twins.bench import VirtualBench

SMALL = ('trajectory.raster.size=["10 mm", "5 mm"]', "trajectory.raster.settle=0.5 s")
REFUSED = "is the pipeline of a rehearsal ([run] rehearsal), in simulated time: its devices are not reached"
SIMULATED = "stopped where simulated time begins"
MORE = {  # what a command takes besides, to come as far as it can
    "map search": ["--go", "--yes"],
    "calibrate": ["--yes", "--set", "calibration.lowest=-9 mm", "--set", "calibration.top_acceleration=9"],
    "repeat": ["--set", "repeat.count=2"],
    "run resume": ["--yes"],
    "fit compare": ["rehearsed"],
}
SERVERS = ("twin", "desk", "replay watch")  # which go on until they are ended, and move nothing
# Those by which a measured folder, or its pipeline, reaches devices; that of simulated time simulates, or is refused.
SIMULATE = ("run", "run resume", "repeat", "map", "map search", "fit", "fit compare", "fit cycles", "acceptance")
REFUSE = ("doctor", "calibrate", "calibrate teach")


class Laboratory:
    """A computer that has the devices of a rig, and refuses them (a Host)."""

    def __init__(self):
        self.reached = []

    def __getattr__(self, name):
        def reach(*words):
            self.reached.append((name, *words))
            raise ConfigurationError(f"the devices of the laboratory were reached: {name}")

        return reach


@pytest.fixture
def laboratory(monkeypatch):
    def begin(*_):
        raise ConfigurationError(SIMULATED)

    monkeypatch.setattr(VirtualBench, "simulated", begin)
    with use_host(found := Laboratory()):
        yield found


def write_run(folder, pipeline, until=0.5):
    """What a killed run leaves: its pipeline, and online estimates until a share of its motion."""
    folder.mkdir(parents=True)
    (folder / "pipeline.toml").write_text(resolved_text(pipeline))
    (folder / "given.toml").write_text(pipeline.text)
    (motion,) = pipeline.trajectories.values()
    time = np.arange(0.0, until * motion.total_duration, 0.02)
    head = ["time_s", "x_m", "y_m", "force_N", "position_m", "velocity_m_s"]
    names = ("elasticity", "elasticity_std", "viscosity", "viscosity_std")
    names = [f"dr/kinematic:{name}" for name in (*names, "surface", "surface_std", "force", "nis", "status")]
    rows = np.zeros((len(time), len(head) + len(names)))
    rows[:, 0] = time + pipeline.safety.standstill
    rows[:, [1, 2, 4]] = motion.at(time).position
    rows[:, 6:] = (1.1e5, 2e3, 360.0, 20.0, 0.0, 1e-5, 1.0, 1.0, 0.0)
    rows[:, 6] += 1e3 * np.sin(time)
    np.savetxt(folder / "estimates.csv", rows, "%.9g", ",", header=",".join([*head, *names]), comments="")


@pytest.fixture
def rig(root):
    def load(*sets):
        return load_pipeline(root / "pipelines" / "raster_ur3e.toml", [*SMALL, *sets])

    return load


@pytest.fixture
def folders(rig, tmp_path):
    """One of a rehearsal, and the same of a run that measured."""
    write_run(tmp_path / "rehearsed", rig('run.rehearsal="bench"'))
    write_run(tmp_path / "measured", rig())
    return tmp_path


def commands_of_a_file():
    """Every command whose first argument is a path."""
    with only_plugins("off"):  # whatever else is installed
        commands = load_commands().commands
    for name, command in commands.items():
        parameters = list(inspect.signature(function_of(command), eval_str=True).parameters.values())
        if parameters and "Path" in str(parameters[0].annotation) and name not in SERVERS:
            yield name


def said(done):
    return " ".join((done.stdout + done.stderr).split())


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(commands_of_a_file()))
def test_no_command_reaches_a_device_from_a_folder_of_simulated_time(palpate, folders, laboratory, name):
    """A new command that moves an arm belongs into one of the two lists."""

    def outputs(folder):
        starts = (folders / folder, folders / folder / "pipeline.toml")
        return [said(palpate(*name.split(), start, *MORE.get(name, []), cwd=folders)) for start in starts]

    told = outputs("rehearsed")
    assert laboratory.reached == [], told
    assert any(SIMULATED in text for text in told) == (name in (*SIMULATE, "rehearse")), told
    assert any(REFUSED in text for text in told) == (name in REFUSE), told
    outputs("measured")
    assert bool(laboratory.reached) == (name in (*SIMULATE, *REFUSE) and name != "acceptance")  # which asks first


@pytest.mark.parametrize("name", ["run resume", pytest.param("map search", marks=pytest.mark.slow)])
def test_what_continues_a_rehearsal_does_so_in_simulated_time_and_says_so(palpate, folders, laboratory, name):
    done = palpate(*name.split(), folders / "rehearsed", *(["--go"] if name == "map search" else []), cwd=folders)
    assert done.returncode == 2
    assert SIMULATED in said(done)
    assert "the pipeline is used as recorded" in said(done)
    assert "in simulated time as the rehearsal was: nothing real moves" in said(done)
    assert laboratory.reached == []


def test_a_pipeline_of_a_rehearsal_never_reaches_its_devices_in_real_time(rig, laboratory, tmp_path):
    with pytest.raises(ConfigurationError, match=SIMULATED):
        run_pipeline(rig('run.rehearsal="bench"'), tmp_path / "out")
    assert laboratory.reached == []


@pytest.mark.slow
def test_a_rehearsal_cannot_be_made_a_measurement_by_its_settings(folders, rig):
    for setting in ('run.rehearsal=""', "run.rehearsal=false"):
        with pytest.raises(ConfigurationError, match="rehearsal"):
            rig(setting)
    with pytest.raises(ConfigurationError, match=r"no \[twin.benk\]; did you mean 'bench'"):
        rig('run.rehearsal="benk"')
    changed = remaining_pipeline(folders / "rehearsed", ['run.rehearsal="other"', "safety.speed=30 mm/s"])
    assert (changed.run.rehearsal, changed.safety.speed) == ("bench", 0.03)


def test_a_folder_of_an_earlier_version_is_known_by_its_result(folders, monkeypatch):
    """It says so in its result only."""
    (folders / "measured" / "result.json").write_text("{}")
    monkeypatch.setattr(RunFolder, "result", {"run": {"rehearsal": {"twin": "bench"}}})
    assert remaining_pipeline(folders / "measured").run.rehearsal == "bench"


@pytest.mark.slow
def test_simulated_and_measured_parts_are_never_joined(palpate, folders, rig):
    write_run(folders / "measured" / "part-2", rig('run.rehearsal="bench"'))
    write_run(folders / "rehearsed" / "part-2", rig())
    for name in ("measured", "rehearsed"):
        with pytest.raises(LogError, match="holds simulated and measured parts, which are never joined"):
            _ = RunFolder(folders / name).parts
    for words in (["map"], ["map", "search"], ["run", "resume"], ["report"]):
        done = palpate(*words, folders / "rehearsed")
        assert done.returncode == 2, words
        assert "which are never joined" in said(done)


@pytest.mark.slow
def test_a_robot_goes_on_only_once_somebody_says_that_specimen_and_tool_are_the_same(palpate, folders, laboratory):
    run = folders / "measured"
    done = palpate("run", "resume", run)
    assert done.returncode == 2
    assert "the pipeline is used as recorded" in said(done)
    assert "are specimen and tool still the same, and where they were? no answer; --yes continues" in said(done)
    assert laboratory.reached == []
    done = palpate("run", "resume", run, "--yes", "--set", "trajectory.raster.speed=2 mm/s")
    assert done.returncode == 2
    assert "what is left of a motion is as recorded" in said(done)
    assert laboratory.reached == []
    done = palpate("run", "resume", run, "--yes", "--set", "device.arm.host=10.0.0.9")
    assert ("controller_facts", "10.0.0.9") in [words[:2] for words in laboratory.reached]


@pytest.mark.slow
def test_a_rehearsal_that_was_stopped_is_continued_to_its_end_without_the_laboratory(palpate, root, tmp_path):
    """Over 20 s, for a raster in two parts and its replay: the door by which a rehearsal once moved a real arm."""
    sets = [word for entry in SMALL for word in ("--set", entry)]
    with use_host(found := Laboratory()):
        words = ("--out", "r", "--fault", "protective-stop@5 s", "--hold-up", "main 2 ms every 1 s")
        stopped = palpate("rehearse", root / "pipelines" / "raster_ur3e.toml", *words, *sets)
        assert stopped.returncode == 1, stopped.stderr
        done = palpate("run", "resume", "r")
        assert done.returncode == 0, done.stderr
        assert "nothing is left to do" in palpate("run", "resume", "r").stdout
        assert "sites" in palpate("map", "r").stdout
    assert found.reached == []
    document = json.loads((tmp_path / "r" / "part-2" / "result.json").read_text())
    assert document["run"]["rehearsal"]["twin"] == "bench"
    assert document["run"]["rehearsal"]["faults"] == document["run"]["rehearsal"]["hold_ups"] == []
    assert "rehearsal" in {flag["code"] for flag in document["tracks"]["dr/kinematic"]["flags"]}
    replayed = palpate("replay", "r", "--out", "again")
    assert replayed.returncode == 0, replayed.stderr
    assert "note[rehearsal] simulated time, twin bench" in replayed.stdout
