"""The UR3e: kinematics, servo law, and the device against its twin."""

import os
import socket
import tempfile
from pathlib import Path

import numpy as np
import pytest
from palpate import ArmLimits, DeviceError
from palpate_arms.servo import Commander
from palpate_arms.servo_law import ServoLaw, straight_path
from palpate_arms.setpoint_buffer import PERIOD, Plan
from palpate_devices.ur.client_sockets import drop_unsent, send_at_once
from palpate_devices.ur.device import UR
from palpate_kit.kinematics.rotations import matrix_of, rotation_matrix, rotation_vector
from palpate_kit.kinematics.ur_arm import UR3E
from palpate_testing import check_trajectory
from palpate_trajectories.point import Point

WORK = {"origin": (-0.3, -0.13, 0.1)}
TCP = matrix_of([0.0, 0.0, 0.12, 0.0, 0.0, 0.0])
WIDE = ArmLimits((-1.0,) * 3, (1.0,) * 3, 2.0, 20.0, 0.3, 0.5)
PRESS = Point(bias=0.002, amplitude=0.0005, clearance=0.003, standstill=0.0, duration=0.5)


def test_the_posture_of_the_paper():
    np.testing.assert_allclose(UR3E.flange([0.0] * 6)[0][:3, 3], (-0.45675, -0.22315, 0.0665), atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_the_jacobian_is_the_derivative(seed):
    q = np.random.default_rng(seed).uniform(-2, 2, 6)
    _, jacobian = UR3E.tip(q, TCP)
    for joint in range(6):
        step = np.zeros(6)
        step[joint] = 1e-6
        ahead, behind = UR3E.tip(q + step, TCP)[0], UR3E.tip(q - step, TCP)[0]
        np.testing.assert_allclose((ahead - behind)[:3, 3] / 2e-6, jacobian[:3, joint], atol=1e-8)
        turn = rotation_vector(ahead[:3, :3] @ behind[:3, :3].T) / 2e-6
        np.testing.assert_allclose(turn, jacobian[3:, joint], atol=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_inverse_kinematics(seed):
    rng = np.random.default_rng(seed)
    q = np.array([0.3, -1.3, -1.9, -1.5, 1.57, 0.2]) + rng.normal(0, 0.1, 6)
    found = UR3E.joints_at(UR3E.tip(q, TCP)[0], TCP, q + rng.normal(0, 0.05, 6))
    np.testing.assert_allclose(found, q, atol=1e-8)
    assert UR3E.joints_at(matrix_of([2.0, 0.0, 0.0, 0.0, 0.0, 0.0]), TCP, q) is None


@pytest.mark.parametrize("vector", [(0, 0, 0), (1e-9, 0, 0), (0.3, -0.2, 0.1), (np.pi, 0, 0), (2.2214, 2.2214, 1e-4)])
def test_rotation_vectors_come_back(vector):
    matrix = rotation_matrix(vector)
    np.testing.assert_allclose(rotation_matrix(rotation_vector(matrix)), matrix, atol=1e-7)


LAW = ServoLaw("pd", 20.0, 0.5, 0.02, 0.05, 1.0)


def followed(commander, position, steps, until="done"):
    """An ideal arm, one period behind its command."""
    track, before = [position], position
    for _ in range(steps):
        command = commander.next(position, (position - before) / PERIOD)
        before, position = position, command.copy()
        track.append(position)
        if commander.mode == until:
            break
    return np.array(track)


@pytest.mark.parametrize("length", [0.0, 1e-4, 1.6e-3, 5e-3, 0.03])
def test_the_way_to_the_start_keeps_what_it_promises(length):
    """Rest to rest, straight, below its speed and acceleration; and it is the way that the arm goes."""
    begin, end = np.array([0.001, -0.002, 0.02]), np.array([0.001, -0.002, 0.02 - length])
    found = straight_path(begin, end, LAW)
    times, position, velocity = found.times, found.position, found.velocity
    np.testing.assert_allclose(position[[0, -1]], [begin, end], atol=1e-12)
    np.testing.assert_allclose(velocity[[0, -1]], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.gradient(position[:, 2], times)[1:-1], velocity[1:-1, 2], atol=2e-4)
    assert np.abs(velocity).max() <= LAW.approach_speed * (1 + 1e-9)
    assert np.abs(np.diff(velocity, axis=0)).max() / PERIOD <= LAW.acceleration
    commander = Commander(LAW, begin)
    commander.follow(Plan.of(np.tile(np.array([*end, 0.0, 0.0, 0.0, 0.0]), (5, 1))))
    track = followed(commander, begin, len(times), until="follow")
    np.testing.assert_allclose(track[: len(times)], position[: len(track)], atol=1e-12)


def test_it_goes_to_the_start_and_follows():
    setpoint = PRESS.at(np.arange(0, PRESS.total_duration, PERIOD))
    table = np.column_stack([setpoint.position, setpoint.velocity, setpoint.measuring])
    commander = Commander(LAW, np.array([0.001, 0.0, 0.01]))
    commander.follow(Plan.of(table))
    track = followed(commander, np.array([0.001, 0.0, 0.01]), 5000)
    assert commander.mode == "done"
    # 20/s of gain lag the sine by less than 0.6 of its amplitude; the depth is reached.
    assert track[:, 2].min() == pytest.approx(-0.0024, abs=3e-4)
    assert np.abs(np.diff(track[:, 2])).max() / PERIOD < 0.06


def test_it_retracts_along_the_normal_from_any_motion():
    setpoint = PRESS.at(np.arange(0, PRESS.total_duration, PERIOD))
    table = np.column_stack([setpoint.position, setpoint.velocity, setpoint.measuring])
    for steps in (100, 200, 300, 500):
        commander = Commander(LAW, np.array([0.0, 0.0, 0.003]))
        commander.follow(Plan.of(table))
        before = followed(commander, np.array([0.0, 0.0, 0.003]), steps)
        commander.retract()
        track = followed(commander, before[-1], 3000)
        assert commander.mode == "done"
        assert track[-1, 2] == pytest.approx(0.003, abs=1e-4)
        acceleration = np.abs(np.diff(track[1:, 2], 2)).max() / PERIOD**2
        assert acceleration < 1.6
        speed = before[-1, 2] - before[-2, 2]
        assert track[:, 2].min() > before[-1, 2] - 0.5 * (speed / PERIOD) ** 2 - 1e-4


def states(device, trajectory=None, count=150):
    with device.connect(0) as link:
        found, stopped = {}, []
        for batch in link.batches():
            found.setdefault(batch.stream, []).append(batch)
            if trajectory is not None and sum(len(b.time) for b in found.get("tip", [])) > 5:
                link.limit(WIDE, stopped.append)
                link.follow(trajectory)
                trajectory, count = None, 1 << 30
            if sum(len(b.time) for b in found.get("status", [])) > count:
                break
        if stopped:
            raise DeviceError(stopped[0])
        return {n: (np.concatenate([b.time for b in bs]), np.concatenate([b.values for b in bs])) for n, bs in
                found.items()}, link.health  # fmt: skip


def device(twin, **changes):
    """The twin's arm, with patience for a machine that is busy."""
    pytest.importorskip("rtde_control", reason="ur-rtde is not installed")
    patient = {"controller_timeout": 5.0, "watchdog": 1.0, "host_timeout": 10.0, "start": 60.0}
    return UR.model_validate({"host": twin.host, "work": WORK, **patient, **changes})


@pytest.mark.slow
@pytest.mark.talks
def test_controller_and_own_kinematics_agree(restored):
    found, health = states(device(restored))
    _, dh_health = states(device(restored, kinematics="dh"))
    assert health["kinematics_mismatch"] < 1e-6
    assert dh_health["kinematics_mismatch"] < 1e-6
    joints, pose = found["joints"][1], found["tip"][1]
    own = UR3E.tip(joints[-1, :6].tolist(), TCP)[0]
    np.testing.assert_allclose(own[:3, 3] - np.array(WORK["origin"]), pose[-1, :3], atol=1e-6)
    np.testing.assert_allclose(pose[-1, 3:], [1, 0, 0, 0], atol=1e-3)  # half a turn about x: it looks down


@pytest.mark.parametrize(("control", "kinematics"), [("pd", "controller"), ("servo", "dh")])
def test_it_follows_a_motion(restored, control, kinematics):
    check_trajectory(PRESS)
    found, health = states(device(restored, control=control, kinematics=kinematics), PRESS)
    assert health["kinematics_mismatch"] < 1e-6  # with "dh", of every state on the way
    modes = found["status"][1][0, 1:]  # of robot, safety and program; speed slider, scaling
    assert modes.tolist() == [7, 1, 2, 1, 1]
    position, wanted = found["tip"][1][:, 2], found["setpoint"][1][:, 2]
    measuring = found["setpoint"][1][:, 6] > 0.5
    assert 0.1 < measuring.sum() * PERIOD < 0.7  # of which a busy computer does not see all
    assert position[measuring].mean() == pytest.approx(-0.002, abs=4e-4)
    assert np.abs(position - wanted).max() < 0.003
    commands = health["commands"]
    assert commands["cycles"] + commands["periods_lost"] > 0.9 * PRESS.total_duration / PERIOD
    velocity, time = found["twist"][1][:, 2], found["status"][1][:, 0]  # the controller's own time
    assert np.corrcoef(velocity[:-1], np.diff(position) / np.diff(time))[0, 1] > 0.5  # states come late


@pytest.mark.slow
@pytest.mark.talks
@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("gone", "RTDE port 30004 cannot be reached"),
        ("mute", "RTDE port 30004 does not answer within 1 s"),
        ("no-port 30003", "script port 30003 cannot be reached"),
        ("no-port 29999", "dashboard port 29999 cannot be reached"),
        ("no-greeting", "dashboard port 29999 does not answer within 1 s"),
        ("local", "not in remote control"),
        ("emergency-stop", "not RUNNING"),
        ("protective-stop", "safety status is PROTECTIVE_STOP"),
        ("safeguard-stop", "safety status is SAFEGUARD_STOP"),
        ("lack actual_TCP_force", r"cannot connect: .*not found by the controller: \[.*actual_TCP_force"),
    ],
)
def test_it_asks_before_it_connects(restored, fault, words):
    restored.fault(fault)
    uploads = restored.state()["uploads"]
    with pytest.raises(DeviceError, match=words):
        states(device(restored))
    assert restored.state()["uploads"] == uploads  # the client library has not been let near


@pytest.mark.slow
@pytest.mark.talks
@pytest.mark.parametrize(
    ("fault", "words"),
    [("refuse-start", "refuses to start sending its state"), ("deaf", "Failed to start control script")],
)
def test_a_controller_that_does_not_begin(restored, fault, words):
    """The library takes 2.5 s and 5 s to notice; it is heard out, and its words are told."""
    restored.fault(fault)
    with pytest.raises(DeviceError, match=words):
        states(device(restored))


@pytest.mark.slow
@pytest.mark.talks
def test_a_controller_that_falls_silent_while_connecting(restored):
    """The library's constructor then hangs for ever: its process is killed."""
    restored.fault("freeze")
    with pytest.raises(DeviceError, match="is not ready within 2 s"):
        states(device(restored, start="2 s"))


@pytest.mark.slow
@pytest.mark.talks
def test_a_second_master_is_refused(restored):
    """By this computer's lock, which names the first; of another computer's the controller alone knows."""
    with device(restored).connect(0):
        with pytest.raises(DeviceError, match=f"is in use by `.*process {os.getpid()}, in {Path.cwd()}, since .*"):
            states(device(restored))
        Path(f"/tmp/palpate-robot-{restored.host}-30004.lock").unlink()
        with pytest.raises(DeviceError, match="already in use"):
            states(device(restored))


def test_a_motion_out_of_reach_ends_in_words(restored):
    far = Point(bias=0.001, amplitude=0.0005, clearance=0.6, standstill=0.0, duration=0.5, speed=1.0)
    with pytest.raises(DeviceError, match=r"out of reach|does not follow|refuses|singular"):
        states(device(restored, start_tolerance=1.0, approach_speed=0.25), far)
    restored.wait_at_rest()


@pytest.mark.slow
@pytest.mark.talks
def test_a_far_start_is_refused(restored):
    with pytest.raises(DeviceError, match="bring it within 30 mm by hand"):
        states(device(restored), Point(bias=0.002, clearance=0.06, duration=0.5))


def test_the_library_keeps_its_connections():
    """They send at once; nothing is held open that the library closes, and no descriptor is left behind."""
    with socket.create_server(("127.0.0.1", 0)) as server, socket.socket() as aside, tempfile.TemporaryFile():
        port = server.getsockname()[1]
        link = socket.create_connection(("127.0.0.1", port))
        served, _ = server.accept()
        before = sorted(os.listdir("/proc/self/fd"))
        assert send_at_once(port) == 1  # not the server's end, whose peer has another port
        assert send_at_once(port + 1) == 0
        assert sorted(os.listdir("/proc/self/fd")) == before
        assert link.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        assert not aside.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        link.close()
        served.settimeout(5.0)
        assert served.recv(1) == b""  # closed for good
        served.close()


def test_a_connection_ends_by_a_reset():
    """What its owner has sent and nobody has acknowledged is not delivered after him."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = socket.create_connection(server.getsockname())
        served, _ = server.accept()
        assert drop_unsent(server.getsockname()[1]) == 1
        link.close()
        served.settimeout(5.0)
        with pytest.raises(ConnectionResetError):
            served.recv(1)
        served.close()
