"""The part without a robot: its kinematics, its words, its rehearsal."""

import json
import math
import socket
import struct
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from palpate import ConfigurationError, DeviceError, UserError
from palpate_commands.acceptance.simulator import Simulator
from palpate_commands.acceptance.steps import all_visits
from palpate_commands.acceptance.watched_arm import WatchedArm
from palpate_engine import check_motion, check_own_motion, load_pipeline, own_motions
from palpate_engine.cli import call
from palpate_franka.models import MODELS, POSTURE
from palpate_franka.robot_states import complaint, error_bits, error_names, explained, names_of
from palpate_kit.kinematics.rotations import matrix_of

PIPELINES = Path(__file__).parents[1]
WITHOUT = """
import sys
sys.modules.update(dict.fromkeys(("franky", "franky_sim", "mujoco", "pinocchio")))
from palpate_engine.cli import main
main()
"""


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_the_flange_is_where_the_manual_has_it(model):
    # Stretched out upwards: 0.333 + 0.316 + 0.384 - 0.107 m high, 0.088 m before the base.
    pose, _ = model.flange([0.0] * 7)
    assert pose[:3, 3] == pytest.approx([0.088, 0.0, 0.926], abs=1e-12)
    assert pose[:3, :3] == pytest.approx(np.diag([1.0, -1.0, -1.0]), abs=1e-12)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_the_tool_looks_down_in_the_posture_that_is_stated(model):
    pose, _ = model.flange(POSTURE)
    assert pose[2, 2] < -0.99
    assert model.end_of(POSTURE) is None


@pytest.mark.parametrize("file", ["point.toml", "raster.toml"])
def test_an_example_is_a_pipeline_whose_motion_keeps_the_limits(file):
    pipeline = load_pipeline(PIPELINES / file)
    arm, (motion,) = pipeline.devices["arm"], pipeline.trajectories.values()
    own = own_motions(pipeline.devices)["arm"]
    assert not check_own_motion(own, pipeline.safety)
    assert own.blind == pytest.approx(arm.host_timeout + arm.command_lag + 0.045)  # it is on a spring
    assert not check_motion(motion, pipeline.safety).problems
    assert arm.controller_stiffness == 5000.0
    assert arm.command_lag == pytest.approx(2.0 / math.sqrt(5000.0))
    assert arm.twin_settings["tcp_rotation"] == str([0.0, 0.0, -math.pi / 4])
    wrench = next(stream for stream in arm.streams if stream.name == "robot_wrench")
    assert wrench.estimated
    assert all(stream.rate is None for stream in arm.streams)  # of a thousand states a second some are not taken


def test_its_acceptance_is_by_the_record_of_the_run_and_open_where_the_simulator_lacks_a_stop():
    pipeline = load_pipeline(PIPELINES / "point.toml")
    assert WatchedArm.of(pipeline).modes.single_connection
    simulator = Simulator.of(pipeline)
    open_steps = {visit.step.name for visit in all_visits() if simulator.lacks(visit)}
    assert open_steps == {"estop", "safeguard", "reflex"}
    assert Simulator.of(load_pipeline(PIPELINES / "point.toml", ['device.arm.host="172.16.0.2"'])) is None


@pytest.mark.parametrize("step", ["safeguard", "reflex", "force"])
def test_its_acceptance_is_rehearsed(tmp_path, step):
    rehearsed = ["--set", 'run.rehearsal="bench"', "--step", step, "--out", str(tmp_path / "out")]
    call(["acceptance", str(PIPELINES / "point.toml"), *rehearsed])
    table = json.loads((tmp_path / "out" / "acceptance.json").read_text())
    assert table["verdict"] == "passed in part"
    assert table["steps"][0]["measured"]["way"] > 0.0


def test_a_reflex_below_the_force_that_stops_the_motion_is_refused():
    pipeline = load_pipeline(PIPELINES / "point.toml", ['device.arm.collision_force="10 N"'])
    (problem,) = check_own_motion(own_motions(pipeline.devices)["arm"], pipeline.safety)
    assert problem.startswith("collision_force is 10 N, at which the controller stops the arm in the material")


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ('device.arm.model="panta"', "panda"),
        ('device.arm.stiffness="50 N/mm"', "stiffness"),
        ('device.arm.rotational_stiffness="80 N*m"', "is a torque, not a rotational stiffness"),
        ('device.arm.collision_force="0 N"', "collision_force"),
        ('device.arm.friction=["1 N*m"]', "friction"),
    ],
)
def test_bad_input_is_named(setting, words):
    with pytest.raises(ConfigurationError, match=words):
        load_pipeline(PIPELINES / "point.toml", [setting])


def test_modes_and_errors_have_names():
    assert complaint(1, []) is None
    assert complaint(2, []) is None
    assert "unlock the joints and activate FCI" in complaint(0, [])
    assert "user stop" in complaint(5, [])
    assert "a person guides it" in complaint(3, [])
    assert "in a reflex" in complaint(4, [])
    assert "mode 9" in complaint(9, [])
    assert "joint_reflex (the torque of a joint was over collision_torque)" in complaint(4, ["joint_reflex"])
    assert explained(["instability_detected"]) == "instability_detected"


def test_errors_survive_as_bits():
    library = SimpleNamespace(Errors=type("Errors", (), {"joint_reflex": False, "cartesian_reflex": False}))
    names = error_names(library)
    for on in ([], ["joint_reflex"], ["cartesian_reflex"], ["cartesian_reflex", "joint_reflex"]):
        errors = SimpleNamespace(**{name: name in on for name in names})
        assert names_of(error_bits(errors, names), names) == on


def test_a_rehearsal_needs_neither_client_nor_simulator(tmp_path):
    specimen = [text for entry in ("elasticity=100 kPa", "viscosity=300 Pa*s") for text in ("--specimen", entry)]
    command = ["rehearse", PIPELINES / "point.toml", *specimen, "--out", tmp_path / "out"]
    short = ["--set", 'trajectory.press.duration="1 s"']
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, *command, *short], capture_output=True, text=True, timeout=900
    )
    assert done.returncode == 0, done.stderr
    assert "What the arm did" in done.stdout


@pytest.mark.parametrize(
    ("host", "words"),
    [
        ("127.9.9.9", r"no simulator is ready at 127\.9\.9\.9: start it by `palpate twin FILE`"),
        ("0.0.0.0", "is FCI activated in Desk"),  # nobody listens there either
    ],
)
def test_a_controller_that_is_not_there_is_refused_by_name(host, words):
    pytest.importorskip("franky")
    from palpate_franka.client import connected

    with pytest.raises(DeviceError, match=words):
        connected(host, "ignore")


def test_a_controller_of_another_version_is_refused_by_name():
    pytest.importorskip("franky")
    from palpate_franka.client import connected

    with socket.create_server(("127.9.9.8", 1337)) as server:

        def answer():
            client, _ = server.accept()
            with client:
                command, number, _ = struct.unpack("<III", client.recv(12))
                client.sendall(struct.pack("<III", command, number, 20) + struct.pack("<HH4x", 1, 5))
                client.recv(64)  # until it is gone

        thread = threading.Thread(target=answer)
        thread.start()
        with pytest.raises(DeviceError, match=r"do not fit; .* a Panda needs one for libfranka 0\.9"):
            connected("127.9.9.8", "ignore")
        thread.join(5.0)


@pytest.fixture
def twin():
    return load_pipeline(PIPELINES / "point.toml", ['twin.bench.host="127.0.76.1"']).twins["bench"]


@pytest.mark.parametrize(
    ("modules", "cores", "words"),
    [
        (("franky_sim", "mujoco"), {0, 1}, r"pip install 'palpate-franka\[sim\]'"),
        ((), {0}, "needs a core to itself"),
    ],
)
def test_what_the_simulator_needs_is_a_sentence(twin, monkeypatch, modules, cores, words):
    if not modules:
        pytest.importorskip("franky_sim")
    for module in modules:
        monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setattr("os.sched_getaffinity", lambda process: cores)
    with pytest.raises(UserError, match=words):
        twin.serve(0, lambda facts: None)


@pytest.fixture
def simulated_rig(twin, tmp_path):
    pytest.importorskip("franky_sim")
    from palpate_franka.simulator.simulated_rig import SimulatedRig, joints_of

    bench = twin.model_copy(update={"port": tmp_path / "sensor", "position_std": 0.0})
    joints = joints_of(bench, MODELS["fr3"], np.array([0.0, 0.0, 0.01]), np.array(POSTURE))
    rig = SimulatedRig(bench, MODELS["fr3"], joints.tolist(), 0)
    yield rig
    rig.close()


def test_restore_brings_the_arm_back_and_lets_it_go(simulated_rig):
    rig = simulated_rig
    rig._step()
    begin = rig._joints
    rig._answer(["lead", "0", "0", "5", "0", "0", "0"])
    for _ in range(300):
        rig._step()
    assert np.abs(rig._joints - begin).max() > 2e-3
    rig._answer(["unplug"])
    assert not rig._bench.port.is_symlink()
    rig._answer(["restore"])
    assert rig._bench.port.is_symlink()
    for _ in range(800):
        rig._step()
    assert not rig._hand.leads
    for _ in range(300):  # held by the controller alone
        rig._step()
    assert rig._joints == pytest.approx(begin, abs=1e-3)


def test_force_and_state_of_the_simulator_are_of_one_instant(simulated_rig):
    rig = simulated_rig
    rig._step()
    rig._answer(["lead", "0", "0", "-3", "0", "0", "0"])
    for _ in range(40):
        rig._step()
    assert rig.record.fastest > 5e-3  # at which a step is 5 um
    bench = rig._bench
    tool = matrix_of([*bench.tcp, *bench.tcp_rotation])
    # By the joints that the state reports, and not by palpate's reading of MuJoCo's bodies.
    pose, _ = MODELS["fr3"].tip(list(rig._control.robot_state.q), tool)
    axes = bench.work.matrix[:3, :3].T
    assert rig._tip()[1] == pytest.approx(axes @ (pose[:3, 3] - bench.work.matrix[:3, 3]), abs=1e-6)


def test_the_simulator_at_rest_reports_the_measured_pose(simulated_rig):
    rig = simulated_rig
    rig._robot.joint_position_control(np.array(rig._robot.initial_q) + 0.05)
    rig._sim.step()
    state = rig._control.robot_state
    reported = np.array(state.O_T_EE).reshape(4, 4, order="F")
    desired = np.array(state.O_T_EE_d).reshape(4, 4, order="F")
    assert np.linalg.norm((reported - desired)[:3, 3]) > 1e-3
