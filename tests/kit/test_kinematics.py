"""Joint states through a robot's kinematics: whatever the order of the joints, the tip is where the arm put it."""

import json
from functools import cache

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from palpate import Batch, Channel, ConfigurationError, LogError, Run, Stream
from palpate_devices.mcap_replay import McapReplay
from palpate_devices.mcap_sink import McapSink
from palpate_devices.messages import JOINTS
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_kit.kinematics.rotations import matrix_of, quaternion as one_quaternion, rotation_matrix
from palpate_kit.kinematics.ur_arm import JOINTS as NAMES, UR3E
from palpate_kit.kinematics.work_frame import WorkFrame
from palpate_kit.logs.joint_kinematics import Kinematics, quaternions, tips
from palpate_logs.rosbag2_replay import Rosbag2Replay
from palpate_testing import check_device

from tests.records.bags import joints_message, wrench_message, write_bag

TOPIC = "/joint_states"
TCP = (0.0, 0.0, 0.12)
TOOL = matrix_of([*TCP, 0.0, 0.0, 0.0])
ALPHABETICAL = sorted(NAMES)  # as the robot's own driver publishes them
WORK = {"origin": ["300 mm", "-100 mm", "150 mm"], "rotation": [0.0, 0.3, 0.2]}


def table(**keys):
    return {"topic": TOPIC, "robot": "ur3e", "tcp": ["0 mm", "0 mm", "120 mm"], **keys}


def angles(count=200, seed=0):
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, (count, 6))


def test_a_block_of_tips_is_every_tip():
    q = angles()
    poses, jacobians = tips(q, Kinematics.model_validate(table()).chain, np.eye(4), TOOL)
    for row, pose, jacobian in zip(q, poses, jacobians, strict=True):
        expected = UR3E.tip(row.tolist(), TOOL)
        np.testing.assert_allclose(pose, expected[0], atol=1e-14)
        np.testing.assert_allclose(jacobian, expected[1], atol=1e-14)


def test_all_joints_at_zero_are_where_the_maker_says():
    bare = Kinematics.model_validate(table(tcp=[0.0, 0.0, 0.0]))
    np.testing.assert_allclose(bare.pose(np.zeros((1, 6)))[0, :3], [-0.45675, -0.22315, 0.0665], atol=1e-12)


def test_quaternions_turn_as_their_rotations_do():
    halves = [rotation_matrix(np.pi * np.array(axis)) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, -0.8, 0))]
    rotations = np.concatenate(
        [
            tips(angles(), Kinematics.model_validate(table()).chain, np.eye(4), TOOL)[0][:, :3, :3],
            np.array(halves),
            np.eye(3)[None],
        ]
    )
    found = quaternions(rotations)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-14)
    expected = np.array([one_quaternion(rotation) for rotation in rotations])
    np.testing.assert_allclose(np.abs((found * expected).sum(axis=1)), 1.0, atol=1e-12)


def test_the_velocity_is_the_derivative_of_the_position():
    kinematics = Kinematics.model_validate(table(work=WORK))
    q, speeds, step = angles(50), angles(50, 1), 1e-6
    ahead, behind = kinematics.pose(q + step * speeds), kinematics.pose(q - step * speeds)
    found = kinematics.twist(np.concatenate([q, speeds], axis=1))
    np.testing.assert_allclose(found[:, :3], (ahead - behind)[:, :3] / (2 * step), atol=1e-8)


@cache
def swing(count=400, rate=100.0):
    """Time [s], angles and speeds of a tip that goes 4 mm deep and swings at 2 Hz along the work frame's normal."""
    work = WorkFrame.model_validate(WORK)
    time = np.arange(count) / rate
    ramp = np.clip((time - 1.0) / 0.5, 0.0, 1.0)
    height = 0.001 * (1 - ramp) - ramp * (0.004 + 0.001 * np.sin(4 * np.pi * (time - 1.0)))
    q, near = [], np.array([0.1, -1.4, 1.6, -1.7, -1.5, 0.2])
    for z in height:
        near = UR3E.joints_at(work.tool_pose(np.array([0.0, 0.0, z])), TOOL, near, steps=200)
        assert near is not None
        q.append(near)
    q = np.array(q)
    return time, height, q, np.gradient(q, time, axis=0)


def messages(order, speeds=True, gripper=False):
    """Joint states in an order of the joints; a gripper's messages on the same topic, where there is one."""
    time, _, q, qd = swing()
    found = []
    for i, (t, position, velocity) in enumerate(zip(time, q, qd, strict=True)):
        names = order(i)
        places = [NAMES.index(name) for name in names]
        stamp = 10**9 + round(t * 1e9)
        found.append((stamp, joints_message(stamp, names, position[places], velocity[places] if speeds else ())))
        if gripper and i % 3 == 0:
            found.append((stamp + 1000, joints_message(stamp + 1000, ["finger"], [0.5], [0.0])))
    return found


def write_mcap(path, topics):
    """An MCAP log of topics: (name, message type, [(stamp, message)])."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros2")
        for name, kind, found in topics:
            channel = writer.register_channel(
                name, "cdr", writer.register_schema(kind.name, "ros2msg", kind.definition.encode())
            )
            for stamp, message in found:
                writer.add_message(channel, stamp, message, stamp)
        writer.finish()
    return path


def read(device):
    with device.connect(0) as link:
        batches = list(link.batches())
    return {
        stream.name: np.concatenate([b.values for b in batches if b.stream == stream.name]) for stream in device.streams
    }


def shuffled(i):
    return np.random.default_rng(i).permutation(NAMES).tolist() if i % 7 == 0 else list(NAMES)


@pytest.mark.parametrize("order", [lambda i: list(NAMES), lambda i: ALPHABETICAL, shuffled], ids=["dh", "abc", "any"])
@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_the_tip_is_where_the_arm_put_it_whatever_the_order_of_the_joints(tmp_path, order, kind):
    found = messages(order, gripper=True)
    if kind == "mcap":
        path = write_mcap(tmp_path / "log.mcap", [(TOPIC, JOINTS, found)])
        device = McapReplay.model_validate({"file": path, "kinematics": table(work=WORK)})
    else:
        path = write_bag(tmp_path / "log.db3", [(TOPIC, JOINTS.name, found)])
        device = Rosbag2Replay.model_validate({"file": path, "kinematics": table(work=WORK)})
    numbers = read(device)
    time, height, _, _ = swing()
    np.testing.assert_allclose(numbers["tip"][:, :3], np.column_stack([0 * time, 0 * time, height]), atol=1e-9)
    np.testing.assert_allclose(numbers["twist"][1:-1, 2], np.gradient(height, time)[1:-1], atol=1e-4)
    check_device(device)


def test_without_speeds_in_the_log_there_is_no_twist(tmp_path):
    path = write_bag(tmp_path / "log.db3", [(TOPIC, JOINTS.name, messages(lambda i: ALPHABETICAL, speeds=False))])
    device = Rosbag2Replay.model_validate({"file": path, "kinematics": table()})
    assert [stream.name for stream in device.streams] == ["tip"]
    assert len(read(device)["tip"]) == len(swing()[0])


def test_another_arm_by_its_own_parameters(shared):
    """Three joints of a real file, as a planar arm with links of 1 m and 0.5 m and a tool of 0.25 m."""
    joints = [{"name": "joint1", "a": "1 m"}, {"name": "joint2", "a": "0.5 m"}, {"name": "joint3"}]
    keys = {"topic": "/test/sensor_msgs/joint_state", "joints": joints, "tcp": ["0.25 m", "0 m", "0 m"]}
    device = McapReplay.model_validate(
        {
            "file": shared / "mcap" / "rosbags-rs_test_bag.mcap",
            "signals": {"f": {"topic": "/test/geometry_msgs/wrench_stamped", "field": "wrench.force.z", "unit": "N"}},
            "kinematics": keys,
        }
    )
    numbers = read(device)
    turned = np.cumsum([0.1, 0.2, 0.3])
    speeds = np.cumsum([0.01, 0.02, 0.03])
    lengths = np.array([1.0, 0.5, 0.25])
    np.testing.assert_allclose(
        numbers["tip"][0, :3], [lengths @ np.cos(turned), lengths @ np.sin(turned), 0.0], atol=1e-14
    )
    velocity = [-(lengths * speeds) @ np.sin(turned), (lengths * speeds) @ np.cos(turned), 0.0, 0.0, 0.0, speeds[-1]]
    np.testing.assert_allclose(numbers["twist"][0], velocity, atol=1e-14)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"topic": "/none"}, r"topic '/none' of the kinematics is not in the log \(there are: /joint_states\)"),
        ({"prefix": "left_"}, r"no message of /joint_states names 'left_elbow_joint' \(there are: elbow_joint, "),
    ],
)
def test_joints_that_are_not_there_are_refused_with_those_that_are(tmp_path, keys, words):
    path = write_bag(tmp_path / "log.db3", [(TOPIC, JOINTS.name, messages(lambda i: ALPHABETICAL))])
    with pytest.raises(LogError, match=words):
        _ = Rosbag2Replay.model_validate({"file": path, "kinematics": table(**keys)}).streams


def test_a_joint_nobody_names_is_refused_in_a_signal_too(tmp_path):
    path = write_bag(tmp_path / "log.db3", [(TOPIC, JOINTS.name, messages(lambda i: ALPHABETICAL))])
    signals = {"q": {"topic": TOPIC, "field": "position", "select": "elbow", "unit": "rad"}}
    with pytest.raises(LogError, match=r"no message of /joint_states names 'elbow' \(there are: elbow_joint"):
        _ = Rosbag2Replay.model_validate({"file": path, "signals": signals}).streams


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"robot": None}, "give either robot"),
        ({"joints": [{"name": "a"}]}, "give either robot"),
        ({"tcp": ["1 mm"]}, "tcp"),
    ],
)
def test_kinematics_that_make_no_sense_are_refused(tmp_path, keys, words):
    with pytest.raises(ValueError, match=words):
        Kinematics.model_validate(table(**keys))


@pytest.mark.gate
@pytest.mark.slow
def test_joint_states_and_a_wrench_in_the_tool_lead_to_the_elasticity(tmp_path):
    """The force is along the skin's normal; the sensor's frame is the tool's, whose orientation the joints give."""
    time, height, q, _ = swing()
    poses, _ = tips(q, Kinematics.model_validate(table()).chain, np.eye(4), TOOL)
    normal = WorkFrame.model_validate(WORK).matrix[:3, 2]
    force = np.where(height < 0, 1.2e4 * np.maximum(-height, 0.0) ** 1.5, 0.0)
    random = np.random.default_rng(0)
    inside = np.einsum("nji,j->ni", poses[:, :3, :3], normal) * force[:, None]
    inside += 0.02 * random.standard_normal(inside.shape)
    wrenches = [
        (stamp := 10**9 + round(t * 1e9), wrench_message(stamp, "tool", [*f, 0.0, 0.0, 0.0]))
        for t, f in zip(time, inside, strict=True)
    ]
    write_bag(
        tmp_path / "log.db3",
        [
            (TOPIC, JOINTS.name, messages(lambda i: ALPHABETICAL)),
            ("/ft/wrench", "geometry_msgs/msg/WrenchStamped", wrenches),
        ],
    )
    (tmp_path / "joints.toml").write_text(
        f"""
[device.log]
type = "rosbag2-replay"
file = "log.db3"

[device.log.kinematics]
topic = "{TOPIC}"
robot = "ur3e"
tcp = ["0 mm", "0 mm", "120 mm"]
work = {{ origin = {json.dumps(WORK["origin"])}, rotation = {WORK["rotation"]} }}

[device.log.signals.force]
topic = "/ft/wrench"
field = "wrench.force"
direction = [0, 0, 1]
orientation = "kinematics"
unit = "N"

[alignment]
force = {{ channel = "log.wrench.force", delay = "0 ms", uncertainty = "0.1 ms" }}
position = "log.tip.z"
velocity = "log.twist.z"
tip_mass = "1 g"

[indenter.tip]
type = "sphere"
radius = "5 mm"

[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
poisson = 0.5

[estimator.kin]
type = "kinematic-ekf"
"""
    )
    result = run_pipeline(load_pipeline(tmp_path / "joints.toml"), tmp_path / "out")
    found = result.tracks["dr/kin"].parameters["elasticity"]
    truth = 0.75 * 0.75 * 1.2e4 / np.sqrt(0.005)
    assert found.value == pytest.approx(truth, rel=0.02)


def test_orientation_by_kinematics_needs_kinematics(tmp_path):
    path = write_bag(
        tmp_path / "log.db3", [("/w", "geometry_msgs/msg/WrenchStamped", [(1, wrench_message(1, "", range(6)))])]
    )
    signal = {"topic": "/w", "field": "wrench.force", "direction": [0, 0, 1], "orientation": "kinematics", "unit": "N"}
    with pytest.raises((LogError, ConfigurationError), match="needs a table of kinematics"):
        _ = Rosbag2Replay.model_validate({"file": path, "signals": {"f": signal}}).streams


def test_recorded_joints_are_joint_states_to_others_and_come_back_to_the_last_bit(tmp_path):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    channels = [Channel(name, "rad") for name in NAMES] + [Channel(f"{name}_speed", "rad/s") for name in NAMES]
    stream = Stream("joints", tuple(channels), 500.0, "joints", "host", "base")
    numbers = np.concatenate([angles(30), angles(30, 1)], axis=1)
    stamps = 17 * 10**17 + np.arange(30) * 2_000_000
    with McapSink().open(Run(tmp_path, {"arm": (stream,)}, {}, {}, {})) as writer:
        writer.batch("arm", Batch("joints", stamps, stamps, numbers))
    path = tmp_path / "log.mcap"
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        theirs = [(schema.name, decoded) for schema, _, _, decoded in reader.iter_decoded_messages()]
    assert {name for name, _ in theirs} == {"sensor_msgs/msg/JointState"}
    for row, stamp, (_, message) in zip(numbers, stamps.tolist(), theirs, strict=True):
        assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamp
        assert (message.header.frame_id, message.name, message.effort) == ("base", list(NAMES), [])
        assert [*message.position, *message.velocity] == row.tolist()
    device = McapReplay(file=path)
    assert device.streams[0].channels == stream.channels
    np.testing.assert_array_equal(read(device)["joints"], numbers)
    again = McapReplay.model_validate({"file": path, "kinematics": table(topic="/arm/joints")})
    poses, _ = tips(numbers[:, :6], Kinematics.model_validate(table()).chain, np.eye(4), TOOL)
    np.testing.assert_allclose(read(again)["tip"][:, :3], poses[:, :3, 3], atol=1e-14)
