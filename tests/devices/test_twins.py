"""The twins: do they speak the protocols as the real ones do?"""

import socket
import struct

import numpy as np
import pytest
from palpate_kit.kinematics.rotations import matrix_of
from palpate_kit.kinematics.ur_arm import UR3E
from palpate_simulation.twins.arm import TICK, SimulatedArm
from palpate_simulation.twins.rtde import ClientSession, packet, packets

pytestmark = pytest.mark.talks

START = np.array([0.0, -1.3, -1.9, -1.5, 1.5708, 0.0])


def session():
    written = {}
    return ClientSession((5, 12, 4, 1101661), lambda s, n: n != "input_int_register_9", written.update), written


def test_rtde_byte_by_byte():
    link, _ = session()
    assert link.answer("V", b"\0\2").hex() == "00045601"
    assert link.answer("v", b"").hex() == "001376000000050000000c000000040010cf5d"
    names = b"timestamp,actual_TCP_pose,runtime_state,"
    assert link.answer("O", struct.pack(">d", 500.0) + names) == packet("O", b"\1DOUBLE,VECTOR6D,UINT32")
    assert link.answer("I", b"input_int_register_0,input_double_register_0,") == packet("I", b"\1INT32,DOUBLE")
    assert link.answer("S", b"").hex() == "00045301"
    data = link.data({"timestamp": 1.5, "actual_TCP_pose": [1.0] * 6, "runtime_state": 2})
    assert len(data) == 0x40
    assert data[:4].hex() == "00405501"


def test_rtde_says_what_it_cannot():
    link, written = session()
    assert b"NOT_FOUND" in link.answer("O", struct.pack(">d", 500.0) + b"timestamp,nonsense,")
    assert b"IN_USE" in link.answer("I", b"input_int_register_9,")
    assert link.answer("I", b"input_int_register_0,")[3] == 1
    link.answer("U", b"\1" + struct.pack(">i", 24))
    assert written == {"input_int_register_0": 24}
    buffer = bytearray(b"\0\2V")
    with pytest.raises(ValueError, match="shorter than its header"):
        list(packets(buffer))


def test_a_rate_below_500_is_decimated():
    link, _ = session()
    link.answer("O", struct.pack(">d", 200.0) + b"timestamp,")
    link.answer("S", b"")
    assert sum(bool(link.data({"timestamp": 0.0})) for _ in range(100)) == 50


def test_the_arm_follows_what_its_limits_allow():
    arm = SimulatedArm(START.copy(), matrix_of([0, 0, 0.12, 0, 0, 0]))
    goal = START + 0.02
    arm.servo(goal, 0.03, 2000.0)
    positions = []
    for _ in range(500):
        arm.advance()
        positions.append(arm.q)
    np.testing.assert_allclose(arm.q, goal, atol=1e-6)
    speed = np.diff(positions, axis=0) / TICK
    assert np.abs(np.diff(speed, axis=0)).max() / TICK < 81
    # Speed is the derivative of position at the instant, not a period late.
    assert not arm.moving


def test_moves_end_where_they_should():
    arm = SimulatedArm(START.copy(), matrix_of([0, 0, 0.12, 0, 0, 0]))
    goal = UR3E.tip(START.tolist(), arm.tcp)[0]
    goal[2, 3] += 0.05
    assert arm.move_linear([*goal[:3, 3], *[3.14159265, 0, 0]], 0.25, 1.2)
    for _ in range(400):
        arm.advance()
    assert arm.pose[2] == pytest.approx(goal[2, 3], abs=1e-4)
    assert not arm.move_linear([3.0, 0, 0, 0, 0, 0], 0.25, 1.2)
    assert not arm.servo_to_pose([float("nan")] * 6, 0.1, 300)


def ask(host, text):
    with socket.create_connection((host, 29999), timeout=60) as link:
        lines = link.makefile("rw", newline="\n")
        greeting = lines.readline()
        lines.write(text + "\n")
        lines.flush()
        return greeting.strip(), lines.readline().strip()


@pytest.mark.slow
def test_the_dashboard(restored):
    greeting, version = ask(restored.host, "PolyscopeVersion")
    assert greeting == "Connected: Universal Robots Dashboard Server"
    assert version.startswith("URSoftware 5.12.4.1101661")
    assert ask(restored.host, "get serial number")[1].isdigit()
    assert ask(restored.host, "stop")[1] == "Stopped"
    assert ask(restored.host, "safetystatus")[1] == "Safetystatus: NORMAL"
    restored.fault("protective-stop")
    assert ask(restored.host, "unlock protective stop")[1].startswith("Cannot unlock protective stop until 5s")
    assert "could not understand" in ask(restored.host, "dance")[1]


def test_an_unknown_fault_is_told(restored):
    assert restored.say("dance").startswith("unknown: dance")
    assert "needs a number" in restored.say("stall long")


@pytest.mark.slow
def test_a_second_twin_at_one_address_is_refused(palpate, restored, root):
    done = palpate(
        "twin",
        root / "pipelines" / "point_ur3e.toml",
        "--set",
        f"twin.bench.host={restored.host}",
        "--set",
        f"twin.bench.port={restored.port}-2",
    )
    assert done.returncode == 1
    assert "is a twin running?" in done.stderr
