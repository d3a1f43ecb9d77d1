"""A column that is not a length or a force by its name and unit is asked for; one that is, is recognised as before."""

import json

import numpy as np
import pytest
from palpate import ConfigurationError, LogError
from palpate_logs.csv_roles import suggest_csv

from tests.records.bags import joints_message, wrench_message, write_bag

TIP = ["--tip", "paraboloid 3 mm"]
_NO_HEIGHTS = (
    "joint_2|Joint 2|q2|actual_q_2|position[2]|/joint_states/elbow_joint/position|theta|motor_angle|gripper_width_m|"
    "finger_joint1|motor_steps|encoder|encoder_counts|z_steps|position_counts|pot_V|z [counts]|Position (pulses)|"
    "position (deg)|motor_position|stepper_position|ch1|Column 3|B|x|value|Tz|temperature|rz|orientation.z|adc0|"
    "Force (mm)"
)
_HEIGHTS = (
    "z|Z|z_mm|height|Position|pos_z|position_z|pose.position.z|/tcp/pose/position/z|actual_TCP_pose_2|tcp_position[2]|"
    "Extension|Displacement|Distance|Travel|Stroke|Piezo|Indentation|depth|h|d|delta|Weg|Stage (mm)|Encoder (mm)|"
    "joint_2_mm|Load displacement (mm)|position_raw|LVDT (mm)|Gap (mm)|ZPos|x_m"
)
_NO_FORCES = (
    "loadcell_V|load_cell_mV|loadcell_counts|loadcell_raw|loadcell_v|force_V|Fz_V|sensor_V|hx711|raw|AI0|ch1|tau_ext_2|"
    "torque|Tz|effort[2]|motor_current|moment|stress|Force (V)|Load (counts)|Force (bits)|Torque (Nm)|wrench.torque.z|"
    "Position (N)|Load cell voltage|temp|value"
)
_FORCES = (
    "Fz|F|F_z|F_n|Force|force_z|force_N|Load|wrench.force.z|actual_TCP_force_2|tcp_force[2]|ft_z|force_raw|<F>|F_mean|"
    "Kraft|Kuvvet|Carga|loadcell|load_cell|loadcell_g|Load (kg)|P (mN)|z (N)|ch1_N|AI0 [N]|Effort (N)|vDeflection (N)|"
    "Load 1"
)
NO_HEIGHTS, HEIGHTS, NO_FORCES, FORCES = (names.split("|") for names in (_NO_HEIGHTS, _HEIGHTS, _NO_FORCES, _FORCES))


def press(seed=0, n=600):
    """Time [s], height [mm] and force [N] of a press of 1.4 mm on 50 kPa by a paraboloid of 3 mm."""
    noise = np.random.default_rng(seed).standard_normal((2, n))
    time = np.arange(n) / 100.0
    depth = 1.5 * np.clip((time - 1.0) / 3.0, 0.0, 1.0) - 0.1
    force = 16 / 9 * 50e3 * np.sqrt(3e-3) * np.maximum(1e-3 * depth, 0.0) ** 1.5
    return time, -depth + 1e-3 * noise[0], force + 2e-3 * noise[1]


def table(path, columns):
    """A table between tabs of columns by name."""
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, fmt="%.6g", delimiter="\t", header="\t".join(columns), comments="")
    return path


def is_taken(path, role, name):
    """Whether a column has a role without being asked for."""
    try:
        found = suggest_csv(path, {"tip": "paraboloid 3 mm"})
    except LogError:
        return False
    return not found.blanks and not found.rivals and found.device["columns"][role]["column"] == name


@pytest.mark.parametrize(
    ("role", "names", "taken"),
    [
        ("position", NO_HEIGHTS, False),
        ("position", HEIGHTS, True),
        ("force", NO_FORCES, False),
        ("force", FORCES, True),
    ],
)
@pytest.mark.slow
def test_what_a_name_states_is_taken_and_anything_else_is_asked_for(tmp_path, role, names, taken):
    """Most of the other quantities were taken for a height or a force, without a word."""
    time, height, force = press()
    wrong = []
    for name in names:
        beside = {"Fz (N)": force, name: height} if role == "position" else {"z (mm)": height, name: force}
        path = table(tmp_path / "a.txt", {"time (s)": time, **beside})
        if is_taken(path, role, name) is not taken:
            wrong.append(name)
    assert wrong == []


def test_an_angle_of_a_joint_is_not_a_height(palpate, tmp_path):
    """It was 16.42 +- 0.26 kPa, good: joint_2 was taken in metres."""
    time, height, force = press()
    noise = 4e-3 * np.random.default_rng(1).standard_normal((2, len(time)))
    columns = {"joint_1": 0 * time + 0.1, "joint_2": 4e-3 * height - 1.2, "joint_3": 1.6 - 4e-3 * height}
    wrench = {"Fx": noise[0], "Fy": noise[1], "Fz": force}
    table(tmp_path / "joints.txt", {"time": time, **columns, **wrench})
    refused = palpate("fit", "joints.txt", *TIP)
    assert refused.returncode == 2
    assert "no column can be the position; choose with --position" in refused.stderr
    assert "by name or unit an angle, a torque or another quantity: joint_1, joint_2, joint_3" in refused.stderr
    asked = palpate("fit", "joints.txt", *TIP, "--position", "joint_2")
    assert asked.returncode == 2
    assert "columns.position.scale: how many mm one unit of column joint_2 is" in asked.stderr


def test_torques_and_angles_are_not_force_and_height(palpate, tmp_path):
    """The torque was offered as the force, and with it stated as the position as well."""
    time, height, force = press()
    columns = {"q2": 0.5 - height, "q3": 0.2 + height, "tau_ext_2": 0.35 * force, "tau_ext_3": -0.2 * force}
    table(tmp_path / "torques.txt", {"time": time, **columns})
    refused = palpate("fit", "torques.txt", *TIP)
    assert refused.returncode == 2
    assert "no two columns can be force and position" in refused.stderr
    assert "an angle, a torque or another quantity: q2, q3, tau_ext_2, tau_ext_3" in refused.stderr
    stated = palpate("fit", "torques.txt", *TIP, "--force", "tau_ext_2")
    assert stated.returncode == 2
    assert "no column can be the position" in stated.stderr
    assert stated.stderr.endswith("another quantity: q2, q3, tau_ext_3\n")


def test_volts_of_a_load_cell_are_not_newtons(palpate, tmp_path):
    """They were taken for N: 19.98 +- 0.31 kPa, good."""
    time, height, force = press()
    table(tmp_path / "volts.txt", {"t": time, "z_mm": height, "loadcell_V": 2.5 + 0.4 * force})
    asked = palpate("fit", "volts.txt", *TIP)
    assert asked.returncode == 2
    assert "how many N one V of column loadcell_V is" in asked.stderr


@pytest.mark.slow
def test_volts_with_their_gain_are_read(palpate, tmp_path):
    time, height, force = press()
    table(tmp_path / "volts.txt", {"t": time, "z_mm": height, "loadcell_V": 2.5 + 0.4 * force})
    done = palpate("fit", "volts.txt", *TIP, "--set", "device.log.columns.force.scale=2.5", "--json", "-o", "out")
    (row,) = json.loads(done.stdout)["files"]
    assert float(row["elasticity"]) == pytest.approx(50e3, rel=0.01)
    shown = palpate("fit", "volts.txt", *TIP, "--set", "device.log.columns.force.scale=2.5", "-o", "again")
    assert 'force "loadcell_V", height "z_mm"\n' in shown.stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("Fz (N)", "depth_mm"), 'force "Fz (N)", height "depth_mm", downwards'),
        (("Fz", "z"), 'force "Fz", height "z", downwards'),
    ],
)
def test_the_output_names_what_was_taken(palpate, tmp_path, names, words):
    time, height, force = press()
    table(tmp_path / "a.txt", {"time (s)": time, names[0]: force, names[1]: -height})
    done = palpate("fit", "a.txt", *TIP, "-o", "out")
    assert done.returncode == 0, done.stderr
    assert words in done.stdout.splitlines()
    assert ("unit of the force: N is a guess" in done.stderr) is (names[0] == "Fz")


def test_a_column_of_an_unknown_name_is_asked_for_everywhere(palpate, tmp_path):
    import palpate as python

    time, height, force = press()
    path = table(tmp_path / "a.txt", {"time (s)": time, "ch1": force, "z (mm)": height})
    asked = palpate("fit", "a.txt", *TIP)
    assert asked.returncode == 2
    words = "no name or unit states which column is the force; by its numbers it can be ch1"
    assert f"{words}; say which with --force" in asked.stderr
    with pytest.raises(ConfigurationError, match=f'{words}: state it in signals={{"force": ...}}'):
        python.read(path)
    shown = palpate("info", "a.txt", "--suggest")
    assert "check: force: column ch1 is a guess" in shown.stderr


def test_turning_elements_of_pose_and_wrench_are_not_compared(tmp_path):
    """Elements 3 to 5 are angles and torques, however well they follow the force."""
    time, height, force = press()
    columns = {f"actual_TCP_pose_{i}": 0 * time + i for i in range(6)}
    columns |= {f"actual_TCP_force_{i}": 0 * time + 0.1 * i for i in range(6)}
    columns |= {"actual_TCP_pose_2": 1e-3 * height, "actual_TCP_force_2": force}
    columns |= {"actual_TCP_pose_4": 0.01 * height, "actual_TCP_force_4": 8.0 * force}
    found = suggest_csv(table(tmp_path / "a.txt", {"timestamp": time, **columns}), {})
    taken = {role: found.device["columns"][role]["column"] for role in ("force", "position")}
    assert taken == {"force": "actual_TCP_force_2", "position": "actual_TCP_pose_2"}
    assert not found.rivals


def test_joints_of_a_bag_are_not_a_height(palpate, tmp_path):
    time, height, force = press()
    stamps = (1e9 * time).astype(int).tolist()
    wrenches = [(t, wrench_message(t, "tool0", [0, 0, f, 0, 0, 0])) for t, f in zip(stamps, force.tolist())]
    joints = [(t, joints_message(t, ["elbow"], [0.01 * z])) for t, z in zip(stamps, height.tolist())]
    kinds = ("geometry_msgs/msg/WrenchStamped", "sensor_msgs/msg/JointState")
    write_bag(tmp_path / "bag.db3", [("/wrench", kinds[0], wrenches), ("/joint_states", kinds[1], joints)])
    refused = palpate("info", "bag.db3", "--suggest")
    assert refused.returncode == 2
    assert "no two numbers can be force and position" in refused.stderr
