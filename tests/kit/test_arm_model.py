"""Kinematic models of arms of any maker: from Denavit-Hartenberg parameters of both forms, and from URDF files."""

import math

import numpy as np
import pytest
from palpate import ConfigurationError
from palpate_kit.kinematics.arm_model import ArmModel, DHJoint, inverse_of
from palpate_kit.kinematics.rotations import matrix_of, rotation_vector
from palpate_kit.kinematics.ur_arm import MODELS, UR3E
from palpate_kit.kinematics.urdf_model import urdf_model

TOOL = matrix_of([0.01, -0.02, 0.12, 0.1, 0.2, 0.3])
QUARTER = math.pi / 2
# Of Franka's Panda, after Craig, as its documentation gives them: a, d, alpha, ends [rad], speed [rad/s].
PANDA = (
    (0.0, 0.333, 0.0, -2.8973, 2.8973, 2.175),
    (0.0, 0.0, -QUARTER, -1.7628, 1.7628, 2.175),
    (0.0, 0.316, QUARTER, -2.8973, 2.8973, 2.175),
    (0.0825, 0.0, QUARTER, -3.0718, -0.0698, 2.175),
    (-0.0825, 0.384, -QUARTER, -2.8973, 2.8973, 2.61),
    (0.0, 0.0, QUARTER, -0.0175, 3.7525, 2.61),
    (0.088, 0.0, QUARTER, -2.8973, 2.8973, 2.61),
)
READY = [0.0, -math.pi / 4, 0.0, -3 * math.pi / 4, 0.0, QUARTER, math.pi / 4]


def panda():
    keys = ("a", "d", "alpha", "low", "high", "speed")
    rows = [dict(zip(keys, row, strict=True)) for row in PANDA]
    joints = [DHJoint(name=f"panda_joint{i}", **row) for i, row in enumerate(rows, 1)]
    return ArmModel.of_dh("panda", joints, flange=0.107, modified=True)


def test_an_arm_of_seven_joints_is_where_its_maker_says():
    """In its ready posture the flange is at (306.9, 0, 590.3) mm, looking down, and turned by 45 deg."""
    pose, _ = panda().flange(READY)
    np.testing.assert_allclose(pose[:3, 3], (0.30689, 0.0, 0.59027), atol=1e-4)
    np.testing.assert_allclose(pose[:3, 2], (0.0, 0.0, -1.0), atol=1e-12)


@pytest.mark.parametrize("model", [panda(), *MODELS.values()], ids=lambda model: model.name)
def test_the_jacobian_is_the_slope_of_the_pose_and_inverts(model):
    rng = np.random.default_rng(0)
    q = rng.uniform(0.4, 0.9, len(model.joints))
    _, jacobian = model.tip(q.tolist(), TOOL)
    for joint in range(len(q)):
        step = np.zeros(len(q))
        step[joint] = 1e-6
        ahead, behind = (model.tip((q + s).tolist(), TOOL)[0] for s in (step, -step))
        np.testing.assert_allclose((ahead - behind)[:3, 3] / 2e-6, jacobian[:3, joint], atol=1e-8)
        turn = rotation_vector(ahead[:3, :3] @ behind[:3, :3].T) / 2e-6
        np.testing.assert_allclose(turn, jacobian[3:, joint], atol=1e-8)
    np.testing.assert_allclose(jacobian @ inverse_of(jacobian), np.eye(6), atol=1e-9)
    goal = model.tip((q + rng.normal(0.0, 0.05, len(q))).tolist(), TOOL)[0]
    found = model.joints_at(goal, TOOL, q)
    np.testing.assert_allclose(model.tip(found.tolist(), TOOL)[0], goal, atol=1e-9)


def test_both_forms_of_parameters_give_one_arm():
    """Every arm of the standard form is one of Craig's with the parameters of each link a joint later."""
    d = [0.2, 0.0, 0.1, 0.3, 0.0, 0.1]
    a, alpha = [0.0, 0.4, 0.05, 0.0, 0.0, 0.0], [QUARTER, 0.0, -QUARTER, QUARTER, -QUARTER, 0.0]
    rows = list(zip(a, d, alpha, strict=True))
    standard = ArmModel.of_dh(
        "one", [DHJoint(name=f"j{i}", a=x, d=z, alpha=w, offset=0.1 * i) for i, (x, z, w) in enumerate(rows)]
    )
    late = zip([0.0, *a[:-1]], d, [0.0, *alpha[:-1]], strict=True)
    modified = ArmModel.of_dh(
        "other",
        [DHJoint(name=f"j{i}", a=x, d=z, alpha=w, offset=0.1 * i) for i, (x, z, w) in enumerate(late)],
        modified=True,
    )
    q = [0.3, -0.4, 0.5, 0.6, -0.7, 0.8]
    np.testing.assert_allclose(standard.flange(q)[0], modified.flange(q)[0], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"low": 1.0, "high": 1.0}, "j0 has no range"),
        ({"high": math.inf}, "high: inf is not a finite angle"),
    ],
)
def test_a_joint_without_ends_makes_no_arm(change, words):
    with pytest.raises(ConfigurationError, match=words):
        ArmModel.of_dh("none", [DHJoint(name=f"j{i}", d=0.1, **(change if i == 0 else {})) for i in range(6)])


def test_a_joint_beyond_its_end_is_named():
    assert panda().end_of(READY) is None
    assert "panda_joint4 would be at 6 deg, beyond its end" in panda().end_of([*READY[:3], 0.1, *READY[4:]])
    assert UR3E.end_of([0.0, 0.0, -6.3, 0.0, 0.0, 0.0]).startswith("elbow_joint would be at -361 deg")


def urdf(joints, path):
    """A file with these joints: name, type, origin xyz, axis, limit element."""
    links = "".join(f'<link name="l{i}"/>' for i in range(len(joints) + 1))
    text = "".join(
        f'<joint name="{name}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="{xyz}" rpy="0.1 0.2 0.3"/><axis xyz="{axis}"/>{limit}</joint>'
        for i, (name, kind, xyz, axis, limit) in enumerate(joints)
    )
    path.write_text(f'<?xml version="1.0"?><robot name="bent">{links}{text}</robot>')
    return path


LIMIT = '<limit lower="-2" upper="2" velocity="1.5" effort="10"/>'
AXES = ("0 0 1", "0 1 0", "0 -1 0", "1 0 0", "0 0 -1", "0.6 0 0.8")


def chain(limit=LIMIT, kind="revolute"):
    joints = [(f"j{i}", "revolute", "0.1 0 0.2", axis, LIMIT) for i, axis in enumerate(AXES)]
    joints[2] = ("j2", kind, "0.1 0 0.2", AXES[2], limit)
    return [*joints, ("hand", "fixed", "0 0 0.1", "1 0 0", "")]


def test_a_urdf_file_is_the_product_of_its_joints(tmp_path):
    pytest.importorskip("yourdfpy", reason="yourdfpy is not installed")
    from scipy.spatial.transform import Rotation

    model = urdf_model(urdf(chain(), tmp_path / "arm.urdf"), "l0", "l7")
    assert (model.joints, model.low, model.speed) == (tuple(f"j{i}" for i in range(6)), (-2.0,) * 6, (1.5,) * 6)
    q, pose = [0.3, -0.4, 0.5, 0.6, -0.7, 0.8], np.eye(4)
    for (_, kind, xyz, axis, _), angle in zip(chain(), [*q, 0.0], strict=True):
        origin, turn = np.eye(4), np.eye(4)
        origin[:3, 3] = np.array(xyz.split(), float)
        origin[:3, :3] = Rotation.from_euler("xyz", (0.1, 0.2, 0.3)).as_matrix()
        direction = np.array(axis.split(), float)
        turn[:3, :3] = Rotation.from_rotvec(angle * direction if kind != "fixed" else np.zeros(3)).as_matrix()
        pose = pose @ origin @ turn
    np.testing.assert_allclose(model.flange(q)[0], pose, atol=1e-12)


@pytest.mark.parametrize(
    ("joints", "ends", "words"),
    [
        (chain(limit=""), ("l0", "l7"), "joint 'j2' has no limits: lower, upper and velocity are needed"),
        (chain(limit='<limit lower="-2" upper="2" effort="1"/>'), ("l0", "l7"), "joint 'j2' has no limits"),
        (chain(kind="prismatic"), ("l0", "l7"), "joint 'j2' is prismatic"),
        (chain(), ("base", "l7"), "no joints lead from link 'base' to link 'l7'"),
    ],
)
def test_a_urdf_file_that_allows_nothing_is_refused_by_name(joints, ends, words, tmp_path):
    pytest.importorskip("yourdfpy", reason="yourdfpy is not installed")
    with pytest.raises(ConfigurationError, match=rf"arm\.urdf: {words}"):
        urdf_model(urdf(joints, tmp_path / "arm.urdf"), *ends)
