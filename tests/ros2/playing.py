"""A recorded run as a ROS 2 laboratory would publish it: the tip's way as joint states of a UR3e, and the wrench.

The run is palpate's own, simulated; what plays it (publisher.cpp) reads plain numbers and knows nothing of palpate.
"""

import struct

import numpy as np
from palpate_devices.mcap_replay import McapReplay
from palpate_devices.messages import pack
from palpate_engine import load_pipeline, run_pipeline
from palpate_kit.kinematics.rotations import matrix_of
from palpate_kit.logs.joint_kinematics import Kinematics, tips

SPECIMEN = """
[run]
estimates_interval = 0
[device.rig]
type = "sim"
tip_mass = "140 g"
[device.rig.specimen]
model = "dr"
elasticity = "112.5 kPa"
viscosity = "362 Pa*s"
[trajectory.press]
type = "point"
bias = "4 mm"
amplitude = "1 mm"
frequency = "2 Hz"
duration = "{seconds} s"
[alignment]
force = {{ channel = "rig.wrench.z", uncertainty = "0.1 ms" }}
position = "rig.tip.z"
velocity = "rig.twist.z"
tip_mass = "140 g"
"""
MODEL = """
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
poisson = 0.5
[estimator.kinematic]
type = "kinematic-ekf"
"""
LOG = """
[sink.log]
type = "mcap"
"""
LISTENING = (
    """
[device.ros]
type = "ros2"
domain = {domain}
interface = "lo"
clocks = "one"
patience = "20 s"
listen = "{seconds} s"
[device.ros.kinematics]
topic = "/joint_states"
robot = "ur3e"
tcp = ["0 mm", "0 mm", "120 mm"]
work = {{ origin = {origin} }}
[device.ros.signals]
x = {{ topic = "/wrench", field = "wrench.force.x", unit = "N" }}
force = {{ topic = "/wrench", field = "wrench.force.z", unit = "N" }}
[alignment]
force = {{ channel = "ros.wrench.force", uncertainty = "0.1 ms" }}
position = "ros.tip.z"
velocity = "ros.twist.z"
tip_mass = "140 g"
"""
    + MODEL
    + LOG
)
_DOWN = np.array([0.0, -1.5708, -1.5708, -1.5708, 1.5708, 0.0])  # a UR3e that looks down
_TCP = (0.0, 0.0, 0.12)


def recorded(folder, seconds):
    """A run of a press and so many seconds of a sine: the times [s] and values of tip, twist and wrench."""
    file = folder / "source.toml"
    file.write_text(SPECIMEN.format(seconds=seconds) + MODEL + LOG)
    result = run_pipeline(load_pipeline(file), folder / "source")
    found = {}
    with McapReplay(file=result.folder / "log.mcap", recorded="rig").connect(0) as link:
        for batch in link.batches():
            found.setdefault(batch.stream, []).append((batch.time, batch.values))
    streams = {n: tuple(np.concatenate(part) for part in zip(*parts, strict=True)) for n, parts in found.items()}
    first = min(times[0] for times, _ in streams.values())
    return {name: ((times - first) / 1e9, values) for name, (times, values) in streams.items()}


def zenoh_table(streams):
    """A recorded run as topics for zenoh_publisher.py; messages are stamped when they are sent."""
    chain = [joint.name for joint in Kinematics(topic="/joint_states", robot="ur3e", tcp=_TCP).chain]
    kinds = {
        "/joint_states": ("sensor_msgs::msg::dds_::JointState_", streams["tip"][0], _joints(streams), tuple(chain)),
        "/wrench": ("geometry_msgs::msg::dds_::WrenchStamped_", *streams["wrench"], ()),
    }
    found = []
    for name, (kind, times, values, joints_) in kinds.items():
        packed = pack(np.zeros(len(times), np.int64), "base", values, joints_)
        rows = [[float(t), raw.hex()] for t, raw in zip(times, packed, strict=True)]
        found.append({"name": name, "type": kind, "hash": "RIHS01_0", "qos": "::,7:,:,:,,", "stamped": True})
        found[-1]["messages"] = rows
    return found


def _joints(streams):
    return joints(streams["tip"][1], streams["twist"][1])


def origin():
    """Where the surface is in the base [m], with the robot looking down on it."""
    robot = Kinematics(topic="/joint_states", robot="ur3e", tcp=_TCP)
    return [float(x) for x in robot.pose(_DOWN[None])[0, :3]]


def joints(tip, twist):
    """Angles and speeds (n, 12) of the joints, in the chain's order, that bring the tip where it was (Newton's way)."""
    robot = Kinematics(topic="/joint_states", robot="ur3e", tcp=_TCP)
    tool, wanted = matrix_of([*_TCP, 0, 0, 0]), tip[:, :3] + origin()
    held = tips(_DOWN[None], robot.chain, np.eye(4), tool)[0][0, :3, :3]
    angles = np.tile(_DOWN, (len(tip), 1))
    for _ in range(5):
        pose, jacobian = tips(angles, robot.chain, np.eye(4), tool)
        turn = np.cross(pose[:, :3, :3], held[None], axis=1).sum(axis=2) / 2
        error = np.concatenate([wanted - pose[:, :3, 3], turn], axis=1)
        angles = angles + np.linalg.solve(jacobian, error[:, :, None])[:, :, 0]
    _, jacobian = tips(angles, robot.chain, np.eye(4), tool)
    speeds = np.linalg.solve(jacobian, twist[:, :, None])[:, :, 0]
    assert np.abs(robot.pose(angles)[:, :3] - wanted).max() < 1e-12
    return np.concatenate([angles, speeds], axis=1)


def playback(streams):
    """A recorded run as bytes for the publisher: joint states by the alphabet, as ROS sends them, and the wrench."""
    names = [joint.name for joint in Kinematics(topic="/joint_states", robot="ur3e", tcp=_TCP).chain]
    order = [names.index(name) for name in sorted(names)]
    times = streams["tip"][0]
    moved = _joints(streams)[:, [*order, *(6 + k for k in order)]]
    rows = [(t, 0, row) for t, row in zip(times, moved, strict=True)]
    rows += [(t, 1, row) for t, row in zip(*streams["wrench"], strict=True)]
    rows.sort(key=lambda entry: entry[:2])
    head = b"PLAYBACK" + struct.pack("<I", 2)
    for name, kind in ((b"/joint_states", b"joints"), (b"/wrench", b"wrench")):
        head += struct.pack("<II", len(name), len(kind)) + name + kind
    return head + b"".join(struct.pack("<dII", t, topic, len(row)) + row.tobytes() for t, topic, row in rows)
