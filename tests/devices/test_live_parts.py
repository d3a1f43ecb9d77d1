"""Whole live runs with other parts than the example has: another box, other arms, a raster that is gone on with."""

import json
import signal

import numpy as np
import pytest
from palpate import clock
from palpate_commands.resume import remaining_pipeline
from palpate_devices.mcap_replay import McapReplay
from palpate_devices.ur.device import UR
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_kit.acquisition.computer import host
from palpate_kit.runs.run_folder import RunFolder
from palpate_studies.repeated_runs import perform

from tests.devices.simulated_bench import SHORT

E_TRUE, WORK = 112.5e3, (-0.3, -0.13)
RASTER = """[trajectory.raster]
type = "raster"
size = ["6 mm", "2 mm"]
pitch = "1 mm"
speed = "6 mm/s"
settle = "0.2 s"
press = { bias = "2 mm", amplitude = "0.3 mm", frequency = "5 Hz", clearance = "3 mm" }

"""


def with_table(root, folder, name, text, *sets):
    """The example pipeline with another table in place of one."""
    lines, skipping, out = (root / "pipelines" / "point_ur3e.toml").read_text().splitlines(), False, []
    for line in lines:
        if line.startswith("["):
            skipping = line.startswith(f"[{name}]")
            out += [text] if skipping else []
        out += [] if skipping else [line]
    (folder / "pipeline.toml").write_text("\n".join(out) + "\n")
    return load_pipeline(folder / "pipeline.toml", sets)


@pytest.mark.slow
@pytest.mark.parametrize("box", ["ati", "onrobot"])
def test_a_whole_run_with_a_box_that_speaks_rdt(simulated, root, tmp_path, box):
    simulated(*SHORT, f"twin.bench.sensor={box}")
    sensor = f'[device.sensor]\ntype = "rdt"\nhost = "192.168.1.1"\nbox = "{box}"\n'
    sets = [s for s in SHORT if not s.startswith("device.sensor")]
    result = run_pipeline(with_table(root, tmp_path, "device.sensor", sensor, *sets), tmp_path / "out")
    assert result.interrupted is None
    assert result.tracks["dr/ekf"].parameters["elasticity"].value == pytest.approx(E_TRUE, rel=0.05)
    health = result.run["live"]["devices"]["sensor"]
    assert health["unusable"] == 0


@pytest.mark.parametrize("robot", ["ur10e", "ur16e"])
def test_another_arm_is_known_by_its_kinematics(simulated, robot):
    simulated(*SHORT, f"twin.bench.robot={robot}")
    work = {"origin": (-0.3, -0.13, 0.1)}
    with UR.model_validate({"host": "192.168.1.2", "work": work}).connect(0) as link:
        for batch in link.batches():
            if batch.stream == "tip" and len(batch.time):
                break
        assert link.health["model"] == robot
        assert link.health["kinematics_mismatch"] < 1e-4
        np.testing.assert_allclose(batch.values[-1, :3], [0.0, 0.0, 0.004], atol=1e-4)


def test_a_control_program_starts_after_one_that_was_ended(rig):
    """The command that ended the last one is still in its register."""
    for _ in range(2):
        commands = host().robot_commands(rig.host)
        assert commands.isProgramRunning()
        commands.stopScript()
        clock().sleep(0.01)
        assert not commands.isProgramRunning()


@pytest.mark.slow
def test_a_raster_that_is_gone_on_with_does_what_was_left(simulated, root, tmp_path):
    """What the arm was told in both parts is every line, and none twice but the one that was cut."""
    own = [s for s in SHORT if "trajectory" not in s]
    twin = simulated(*own)
    sets = [*own, 'run.tracks=["*/kinematic"]']
    sets += ["alignment.lateral_x=arm.tip.x", "alignment.lateral_y=arm.tip.y"]
    pipeline = with_table(root, tmp_path, "trajectory.press", RASTER, *sets)
    raised = []

    def interrupt(*_):
        state = twin.state()
        in_the_middle = np.hypot(*np.subtract(state["pose"][:2], WORK)) < 0.6e-3
        if not raised and state["height"] < -0.001 and in_the_middle:
            raised.append(signal.raise_signal(signal.SIGINT))

    first = run_pipeline(pipeline, tmp_path / "out", interrupt)
    assert raised
    assert first.interrupted is not None
    assert twin.wait_at_rest()["height"] > 0.002
    rest = remaining_pipeline(tmp_path / "out")
    second = run_pipeline(rest, RunFolder(tmp_path / "out").next_part)
    assert second.interrupted is None
    done, left = (lines_of(result.folder / "log.mcap") for result in (first, second))
    assert {y for lines in (done, left) for y, length in lines.items() if length > 4.0} == {-1.0, 0.0, 1.0}
    assert min(left) >= max(done)  # none but the one that was cut is gone along again


def lines_of(log):
    """Along how much [mm] of each line, by its place across [mm], the arm was told to go while it measured."""
    with McapReplay(file=log, recorded="arm").connect(0) as link:
        told = np.concatenate([batch.values for batch in link.batches() if batch.stream == "setpoint"])
    told = told[(np.abs(told[:, 3]) > 5e-3) & (told[:, 6] > 0.5)]  # at full speed, and not from one line to the next
    across = np.round(1e3 * told[:, 1], 1) + 0.0
    return {float(y): 1e3 * float(np.ptp(told[across == y, 0])) for y in np.unique(across)}


@pytest.mark.slow
def test_a_palpation_is_made_again_beside_the_last_one(simulated, root, tmp_path):
    """Press, retract, wait, move on, press again: the arm goes on in the air, and each place gives the same E.

    Over 20 s, for three runs, each at a place of its own.
    """
    twin, step = simulated(*SHORT), 0.001
    text = (root / "pipelines" / "point_ur3e.toml").read_text()
    path = tmp_path / "pipeline.toml"
    path.write_text(text + f'\n[repeat]\ncount = 3\nwait = "4 s"\nstep = ["{step} m", "0 mm"]\n')
    folders = perform(path, [*SHORT, 'run.tracks=["*/kinematic"]'], tmp_path / "out")
    assert len(folders) == 3
    tips = [tip_of(folder / "log.mcap") for folder in folders]
    for k, (folder, (time, place)) in enumerate(zip(folders, tips, strict=True)):
        deep = place[:, 2] < -0.001
        assert np.abs(place[deep, 0] - k * step).max() < 1e-4, f"palpation {k + 1} is at its own place"
        assert place[0, 2] > 0.002
        assert place[-1, 2] > 0.002
        table = json.loads((folder / "result.json").read_text())["tracks"]["dr/kinematic"]["parameters"]["elasticity"]
        assert table["value"] == pytest.approx(E_TRUE, rel=0.02)
        if k:
            before = tips[k - 1][0][-1]
            assert 4.0 < time[0] - before < 9.0
    assert twin.wait_at_rest()["height"] > 0.002


def tip_of(log):
    """When [s] and where [m] the tip was, as the arm told."""
    with McapReplay(file=log, recorded="arm").connect(0) as link:
        batches = [batch for batch in link.batches() if batch.stream == "tip"]
    received = np.concatenate([batch.received for batch in batches]) * 1e-9
    return received, np.concatenate([batch.values[:, :3] for batch in batches])
