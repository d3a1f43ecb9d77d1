"""A table's pose and its three axes of force are found by the names of its columns."""

import numpy as np
import pytest
from palpate_logs.csv_roles import suggest_csv
from scipy.spatial.transform import Rotation

QUATERNION = ("qx", "qy", "qz", "qw")
ROTATION = ("rx", "ry", "rz")
TURN = Rotation.from_rotvec([3.0, 0.4, 0.1])
FORCES = ["fx [N]", "fy [N]", "fz [N]"]


def suggested(tmp_path, names, turn):
    """What is suggested for a press along z with the names of time, three forces, three heights and the turn."""
    t = np.arange(0.0, 4.0, 0.01)
    depth = np.maximum(2e-3 * (t - 1.5), 0.0) * (t < 3.0)
    z = 100.0 - 2.0 * t
    noise = np.random.default_rng(0).normal(0.0, 0.01, (len(t), 3))
    force = np.column_stack([0.1 * depth * 500, 0.0 * t, 4e4 * depth**1.5]) + noise
    place = np.column_stack([0.0 * t + 300.0, 0.0 * t - 20.0, z])
    table = np.column_stack([t, force, place, np.tile(turn, (len(t), 1))])
    path = tmp_path / "press.csv"
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="", fmt="%.7g")
    return suggest_csv(path, {}).device["columns"]


@pytest.mark.parametrize(
    ("place", "turn", "values", "keys"),
    [
        (["x [mm]", "y [mm]", "z [mm]"], ["qx", "qy", "qz", "qw"], TURN.as_quat(), QUATERNION),
        (["x [mm]", "y [mm]", "z [mm]"], ["qw", "qx", "qy", "qz"], TURN.as_quat()[[3, 0, 1, 2]], QUATERNION),
        (
            [f"pose.position.{axis}" for axis in "xyz"],
            [f"pose.orientation.{axis}" for axis in "xyzw"],
            TURN.as_quat(),
            QUATERNION,
        ),
        ([f"pos_{axis}_mm" for axis in "xyz"], [f"quat_{axis}" for axis in "xyzw"], TURN.as_quat(), QUATERNION),
        (["X (mm)", "Y (mm)", "Z (mm)"], ["Rx (deg)", "Ry (deg)", "Rz (deg)"], TURN.as_rotvec(degrees=True), ROTATION),
        (
            [f"actual_TCP_pose_{k}" for k in range(3)],
            [f"actual_TCP_pose_{k}" for k in range(3, 6)],
            TURN.as_rotvec(),
            ROTATION,
        ),
        (["x [mm]", "y [mm]", "z [mm]"], ["qx", "qy", "qz", "qw"], 2.0 * TURN.as_quat(), ()),  # of no length one
        (["x [mm]", "y [mm]", "z [mm]"], ["a", "b", "c", "d"], TURN.as_quat(), ()),
    ],
)
def test_the_pose_of_a_table_is_found_by_names(tmp_path, place, turn, values, keys):
    columns = suggested(tmp_path, ["t [s]", *FORCES, *place, *turn], values)
    assert {"force_x", "force_y", "force", "position"} <= {*columns}
    assert [key for key in columns if key[0] in "qr"] == list(keys)
    assert {key for key in columns if key in "xyz"} == ({*"xyz"} if keys else set())
    degrees = "deg" in turn[0]
    assert {columns[key]["unit"] for key in keys} == (
        {"1"} if keys == QUATERNION else {"deg" if degrees else "rad"} if keys else set()
    )
    assert columns["position"]["column"] == place[2]
    assert [*columns].index("force_y") < [*columns].index("force")  # axes are read in their order
