"""Logs that others recorded: whatever states the tool's orientation, force and height over a surface are the same.

The record is the oblique press of `test_oblique_press.py` on a dome, with a tool that rocks; scipy turns its
orientations into each convention.
"""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from palpate.errors import ConfigurationError
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline.tracks import start_tracks
from palpate_kit.logs.draft_pipeline import suggestion_of
from scipy.spatial.transform import Rotation

SPEC = importlib.util.spec_from_file_location("oblique", Path(__file__).with_name("test_oblique_press.py"))
OBLIQUE = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(OBLIQUE)
TABLES = '[surface.dome]\ntype = "half-ellipsoid"\nhalf_axes = ["40 mm", "40 mm", "40 mm"]\n'
AFTER = """
[alignment]
surface = "dome"
weight = "turning"
tare = "none"
force = {{ channel = "{force}", uncertainty = "0.1 ms" }}
position = "{position}"
tip_mass = "140 g"
{more}
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
thickness = "half-space"
[estimator.fit]
type = "casadi-fit"
"""
QUATERNION = ("qx", "qy", "qz", "qw")


def record():
    """Time [s], force (n, 3), place (n, 3) and rotations of a press 30 degrees beside the apex, at 500 Hz."""
    wrench, tip, _ = OBLIQUE.press(np.radians(30.0), 0.3, np.radians(12.0), rates=(500.0, 500.0))
    return tip.time / 1e9, wrench.values, tip.values[:, :3], Rotation.from_quat(tip.values[:, 3:])


def estimated(pipeline):
    """E [Pa] and the alignment's report of a replay."""
    aligner = pipeline.new_aligner()
    with pipeline.devices["log"].connect(0) as link:
        samples = aligner.aligned((("log", batch) for batch in link.batches()), final=True)
    (track,) = start_tracks(pipeline)
    track.run(samples)
    return track.result(aligner.report, pipeline.alignment, 1.0).parameters["elasticity"].value, aligner.report


def csv_pipeline(tmp_path, columns, more="", force="log.fz"):
    """A pipeline that reads a table of columns: values and unit by name, in their order."""
    header, values = ",".join(columns), np.column_stack([values for values, _ in columns.values()])
    np.savetxt(tmp_path / "log.csv", values, delimiter=",", header=header, comments="", fmt="%.9g")
    described = {name: {"column": name, "unit": unit} for name, (_, unit) in columns.items() if name != "t"}
    lines = [f'{name} = {{ column = "{one["column"]}", unit = "{one["unit"]}" }}' for name, one in described.items()]
    device = '[device.log]\ntype = "csv-replay"\nfile = "log.csv"\ntime = { column = "t", unit = "s" }\n'
    text = TABLES + device + "[device.log.columns]\n" + "\n".join(lines)
    (tmp_path / "a.toml").write_text(text + AFTER.format(force=force, position="log.z", more=more))
    return load_pipeline(tmp_path / "a.toml")


def columns(turn, names, unit, order="xyz"):
    time, force, place, _ = record()
    found = {"t": (time, "s")} | {f"f{axis}": (force[:, "xyz".index(axis)], "N") for axis in order}
    found |= {axis: (1e3 * place[:, i], "mm") for i, axis in enumerate("xyz")}
    return found | {name: (turn[:, i], unit) for i, name in enumerate(names)}


TURN = record()[3]


@pytest.mark.parametrize(
    ("turn", "names", "unit", "more"),
    [
        (TURN.as_quat(), QUATERNION, "1", ""),
        (-TURN.as_quat()[:, [3, 0, 1, 2]], ("qw", "qx", "qy", "qz"), "1", ""),  # the scalar first
        (TURN.as_rotvec(degrees=True), ("rx", "ry", "rz"), "deg", ""),
        (TURN.as_euler("ZYX"), ("yaw", "pitch", "roll"), "rad", 'euler = "ZYX"'),
        (TURN.as_euler("xyz", degrees=True), ("roll", "pitch", "yaw"), "deg", 'euler = "xyz"'),
        (TURN.as_euler("xzy"), ("roll", "yaw", "pitch"), "rad", 'euler = "xzy"'),
        (TURN.as_euler("YXZ"), ("pitch", "roll", "yaw"), "rad", 'euler = "YXZ"'),
    ],
)
def test_a_table_states_the_orientation_in_any_convention(tmp_path, turn, names, unit, more):
    elasticity, report = estimated(csv_pipeline(tmp_path, columns(turn, names, unit), more))
    assert elasticity == pytest.approx(OBLIQUE.ELASTICITY, rel=8e-3)
    assert report.turned.tilt < np.radians(45.0)


def test_three_axes_of_force_may_come_in_any_order(tmp_path):
    found = columns(TURN.as_quat(), QUATERNION, "1", order="zxy")
    assert estimated(csv_pipeline(tmp_path, found))[0] == pytest.approx(OBLIQUE.ELASTICITY, rel=8e-3)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("roll", "pitch", "yaw"), 'euler: is needed for roll, pitch and yaw: the order of the turns, such as "ZYX"'),
        (("a", "b", "c"), "log.z is of no pose: of a stream with x, y, z and qx, qy, qz, qw, or rx, ry, rz, or roll"),
    ],
)
def test_an_orientation_that_is_not_understood_is_refused(tmp_path, names, words):
    with pytest.raises(ConfigurationError, match=words):
        csv_pipeline(tmp_path, columns(TURN.as_euler("xyz"), names, "rad"))


def test_an_order_that_is_none_is_refused(tmp_path):
    with pytest.raises(ConfigurationError, match="euler"):
        csv_pipeline(tmp_path, columns(TURN.as_euler("xyz"), ("roll", "pitch", "yaw"), "rad"), 'euler = "xYz"')


def ros_log(path, pose_type):
    """An MCAP log of JSON messages as a bridge writes them: WrenchStamped and a stamped pose of others."""
    from mcap.writer import Writer

    time, force, place, turn = record()
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        ids = {}
        for topic, name in (("/ft/wrench", "geometry_msgs/msg/WrenchStamped"), ("/tracker/pose", pose_type)):
            schema = writer.register_schema(name=name, encoding="jsonschema", data=b'{"type": "object"}')
            ids[topic] = writer.register_channel(topic=topic, message_encoding="json", schema_id=schema)
        keys = ("position", "orientation") if pose_type.endswith("PoseStamped") else ("translation", "rotation")
        inner = "pose" if pose_type.endswith("PoseStamped") else "transform"
        for t, f, p, q in zip(time.tolist(), force.tolist(), place.tolist(), turn.as_quat().tolist(), strict=True):
            stamp = round(t * 1e9) + 1_700_000_000_000_000_000
            header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": "base"}
            wrench = {"force": dict(zip("xyz", f)), "torque": dict.fromkeys("xyz", 0.0)}
            pose = {keys[0]: dict(zip("xyz", p)), keys[1]: dict(zip("xyzw", q))}
            for topic, body in (("/ft/wrench", {"wrench": wrench}), ("/tracker/pose", {inner: pose})):
                data = json.dumps({"header": header} | body).encode()
                writer.add_message(ids[topic], log_time=stamp, data=data, publish_time=stamp)
        writer.finish()


@pytest.mark.parametrize("pose_type", ["geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped"])
def test_a_pose_of_a_ros_log_is_one(tmp_path, pose_type):
    ros_log(tmp_path / "log.mcap", pose_type)
    ends = (
        ("pose.position", "pose.orientation")
        if "Pose" in pose_type
        else ("transform.translation", "transform.rotation")
    )
    lines = [f'f{axis} = {{ topic = "/ft/wrench", field = "wrench.force.{axis}", unit = "N" }}' for axis in "xyz"]
    lines += [f'{axis} = {{ topic = "/tracker/pose", field = "{ends[0]}.{axis}", unit = "m" }}' for axis in "xyz"]
    lines += [f'q{axis} = {{ topic = "/tracker/pose", field = "{ends[1]}.{axis}" }}' for axis in "xyzw"]
    text = TABLES + '[device.log]\ntype = "mcap-replay"\nfile = "log.mcap"\n[device.log.signals]\n' + "\n".join(lines)
    (tmp_path / "a.toml").write_text(text + AFTER.format(force="log.wrench.fz", position="log.pose.z", more=""))
    elasticity, _ = estimated(load_pipeline(tmp_path / "a.toml"))
    assert elasticity == pytest.approx(OBLIQUE.ELASTICITY, rel=8e-3)


@pytest.mark.parametrize("pose_type", ["geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped"])
def test_the_pose_and_three_axes_of_a_record_are_recognised(tmp_path, pose_type):
    ros_log(tmp_path / "log.mcap", pose_type)
    found = suggestion_of(tmp_path / "log.mcap", {})
    lines = [
        f"{name} = {{ {', '.join(f'{k} = {json.dumps(v)}' for k, v in one.items())} }}"
        for name, one in found.device["signals"].items()
    ]
    text = TABLES + '[device.log]\ntype = "mcap-replay"\nfile = "log.mcap"\n[device.log.signals]\n' + "\n".join(lines)
    named = {role: found.alignment[role] for role in ("force", "position")}
    named = {role: one["channel"] if isinstance(one, dict) else one for role, one in named.items()}
    (tmp_path / "a.toml").write_text(text + AFTER.format(**named, more=""))
    assert estimated(load_pipeline(tmp_path / "a.toml"))[0] == pytest.approx(OBLIQUE.ELASTICITY, rel=8e-3)
