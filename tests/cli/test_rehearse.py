"""``palpate rehearse``: a robot's pipeline in simulated time, as a user types it."""

import json
from datetime import UTC, datetime, timedelta

import pytest

from tests.devices.simulated_bench import SHORT

# The twin of the example stands 1 mm above the skin; the press is as short as the limits of acceleration allow.
SHORTER = (
    *(entry for entry in SHORT if "clearance" not in entry and "height" not in entry),
    "trajectory.press.clearance=1 mm",
    "trajectory.press.bias=1.2 mm",
    "trajectory.press.amplitude=0.5 mm",
    "trajectory.press.duration=0.3 s",
    "estimator.ekf.start_depth=1 mm",
    'run.tracks=["dr/ekf"]',
)
SILICONE = ("--specimen", "elasticity=112.5 kPa", "--specimen", "viscosity=362 Pa*s")


@pytest.fixture
def live(root):
    return root / "pipelines" / "point_ur3e.toml"


@pytest.fixture
def rig(live, tmp_path):
    """The same rig without a twin, at addresses that only a laboratory has."""
    text = live.read_text()
    text = text[: text.index("\n[twin.bench]")]
    text = text.replace("127.0.0.1", "192.168.0.17").replace("~/palpate-sensone", "/dev/serial/by-id/usb-bota")
    file = tmp_path / "rig.toml"
    file.write_text(text)
    return file


@pytest.fixture
def rehearse(palpate):
    def run(file, *words, sets=()):
        return palpate("rehearse", file, *(word for entry in sets for word in ("--set", entry)), *words)

    return run


def rows(done):
    """The table of what the arm did: name of the limit -> reached, allowed, left."""
    assert "What the arm did" in done.stdout, done.stderr
    table = done.stdout.partition("What the arm did")[2].splitlines()
    cells = [[cell.strip() for cell in line.split("│")[1:-1]] for line in table if line.startswith("│")]
    return {name: rest for name, *rest in cells}


def number(cell):
    return float(cell.split()[0])


@pytest.mark.gate
@pytest.mark.slow
def test_a_rehearsal_ends_with_what_the_arm_did_and_is_the_same_every_time(rehearse, live, tmp_path):
    sets = (*SHORTER, "twin.bench.height=1 mm")
    first, second = (rehearse(live, "--out", out, sets=sets) for out in "ab")
    assert first.returncode == second.returncode == 0, first.stderr
    assert "; ekf" in " ".join(first.stdout.split())
    assert first.stdout.replace("written to a", "written to b") == second.stdout
    for name in ("estimates.csv", "log.mcap"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert "simulated time, twin bench" in " ".join(first.stdout.split())
    began = datetime.fromisoformat(json.loads((tmp_path / "a" / "result.json").read_text())["run"]["started"])
    assert abs(datetime.now(UTC) - began) < timedelta(hours=1)  # the day on which it was made
    document = json.loads((tmp_path / "a" / "result.json").read_text())
    told = document["run"]["rehearsal"]
    assert (told["twin"], told["faults"], told["hold_ups"], told["seed"]) == ("bench", [], [], 0)
    assert told["specimen"]["parameters"]["elasticity"] == 112.5e3
    assert "rehearsal" in {flag["code"] for flag in document["tracks"]["dr/ekf"]["flags"]}
    table = rows(first)
    assert table["z, low"][1] == "-7.00 mm"
    assert -2.0 < number(table["z, low"][0]) < -1.3  # bias and amplitude are 1.7 mm
    assert 0.5 < number(table["force on the skin"][0]) < 2.0
    for name, (reached, allowed, left) in table.items():
        if left:
            assert 0.0 < number(left) == pytest.approx(abs(number(reached) - number(allowed)), abs=0.011), name


@pytest.mark.slow
def test_a_rig_without_a_twin_is_rehearsed_and_a_fault_after_the_end_is_said(rehearse, rig, tmp_path):
    done = rehearse(rig, *SILICONE, "--fault", "protective-stop@50 s", "--out", "out", sets=SHORTER)
    assert done.returncode == 0, done.stderr
    assert "protective-stop was never made: the run ended before its time" in done.stderr
    assert number(rows(done)["force on the skin"][0]) > 0.3
    tracks = json.loads((tmp_path / "out" / "result.json").read_text())["tracks"]
    elasticity = tracks["dr/ekf"]["parameters"]["elasticity"]
    assert abs(elasticity["value"] - 112.5e3) < 3 * elasticity["combined"]


@pytest.mark.slow
def test_a_fault_ends_the_run_and_the_table_still_stands(rehearse, rig, tmp_path):
    done = rehearse(rig, *SILICONE, "--fault", "protective-stop@0.4 s", "--out", "out", sets=SHORTER)
    assert done.returncode == 1
    assert "192.168.0.17: the robot is in a protective stop" in done.stderr
    told = json.loads((tmp_path / "out" / "result.json").read_text())["run"]["rehearsal"]
    assert (told["twin"], told["faults"]) == ("rehearsal", ["protective-stop@0.4 s"])
    assert number(rows(done)["force on the skin"][0]) == 0.0
    assert (
        "protective stop" in json.loads((tmp_path / "out" / "result.json").read_text())["run"]["live"]["stop"]["reason"]
    )


@pytest.mark.slow
def test_faults_are_made_in_the_order_of_their_times(rehearse, rig):
    words = ("--fault", "freeze@9 s", "--fault", "safeguard-stop@0.3 s")
    done = rehearse(rig, *SILICONE, *words, "--out", "out", sets=SHORTER)
    assert done.returncode == 1
    assert "the robot is in a safeguard stop" in done.stderr
    assert "freeze was never made: the run ended before its time" in done.stderr


@pytest.mark.slow
def test_a_sensor_that_the_computer_holds_up_too_long_is_told(rehearse, rig):
    done = rehearse(rig, *SILICONE, "--hold-up", "sensor 400 ms every 1 s", "--out", "out", sets=SHORTER)
    assert done.returncode == 1
    assert "usb-bota: its process gave no sign of life for 124 ms and was killed" in done.stderr
    assert number(rows(done)["force on the skin"][0]) == 0.0


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("--fault", "protectiv-stop@3 s"), "did you mean 'protective-stop'?"),
        (("--fault", "quit@3 s"), "--fault quit: no such fault"),
        (("--fault", "protective-stop"), "--fault 'protective-stop': expected \"NAME@TIME\""),
        (("--fault", "@3 s"), "--fault '@3 s': expected \"NAME@TIME\""),
        (("--fault", "protective-stop@soon"), "--fault 'protective-stop@soon': 'soon' is not a time"),
        (("--fault", "protective-stop@-1 s"), "'-1 s' is not a time that comes"),
        (("--fault", "stall@3 s"), "--fault 'stall': expected \"stall SECONDS@TIME\""),
        (("--fault", "stall long@0.1 s"), "--fault 'stall long': stall needs a number, not 'long'"),
        (("--hold-up", "robt 8 ms every 1 s"), "robt is unknown; did you mean 'robot'?"),
        (("--hold-up", "robot 8 s every 1 s"), "expected a period of more than the 8000 ms"),
        (("--hold-up", "robot often"), 'expected "WHO DURATION" or "WHO DURATION every PERIOD"'),
        (("--hold-up", "robot 8 parsecs"), "'8 parsecs' is not a time"),
        (("--specimen", "viscosity"), "--specimen 'viscosity': expected \"KEY=VALUE\""),
        (("--specimen", "elastisity=1 kPa"), "parameter 'elastisity' is unknown"),
    ],
)
def test_bad_input_is_named(rehearse, live, rig, words, complaint):
    specimen = () if "elastisity=1 kPa" in words else SILICONE
    done = rehearse(rig, *specimen, *words, "--out", "out", sets=SHORTER)
    assert done.returncode == 2, done.stdout + done.stderr
    assert complaint in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr


def test_a_rig_without_a_twin_needs_a_specimen(rehearse, rig):
    done = rehearse(rig)
    assert done.returncode == 2
    assert "rig.toml has no [twin.*] table: what does the tip press on?" in done.stderr
    assert '--specimen "elasticity=100 kPa"' in done.stderr


def test_a_pipeline_without_a_robot_has_nothing_to_rehearse(rehearse, root):
    done = rehearse(root / "pipelines" / "filters.toml")
    assert done.returncode == 2
    assert "nothing to rehearse: no live device with a [trajectory.*] table" in done.stderr


def test_a_rig_that_no_twin_stands_in_for_is_named(rehearse, rig):
    text = rig.read_text()
    rig.write_text(text.replace("[safety]", '[device.more]\ntype = "bota"\nport = "/dev/ttyUSB1"\n\n[safety]', 1))
    done = rehearse(rig, *SILICONE)
    assert done.returncode == 2
    assert "no twin stands in for arm, sensor, more; a [twin.*] table says what does" in " ".join(done.stderr.split())
