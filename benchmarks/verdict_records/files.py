"""Records as files: noise, sensors' habits, and the forms in which instruments and robots write them."""

from __future__ import annotations

from pathlib import Path
from zlib import crc32

import numpy as np
from scipy.signal import lfilter

from verdict_records.contact import FINE, Specimen
from verdict_records.rigs import RIGS, Column, Rig
from verdict_records.sizes import Readings

_FACTORS = {"N": 1.0, "uN": 1e6, "nN": 1e9, "mm": 1e3, "um": 1e6}
_WRENCH = """std_msgs/Header header
geometry_msgs/Wrench wrench
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Wrench
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
_POSE = """std_msgs/Header header
geometry_msgs/Pose pose
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
"""


def random_of(seed: int, *names: object) -> np.random.Generator:
    """The random numbers of one record."""
    return np.random.default_rng([seed, *(crc32(str(name).encode()) for name in names)])


def drawn(rig: str, random: np.random.Generator) -> Specimen:
    """A material for a rig: E evenly on a logarithmic scale, eta/G evenly."""
    known = RIGS[rig]
    e = float(np.exp(random.uniform(*np.log(known.modulus))))
    return Specimen(known, e, e / 3 * float(random.uniform(*known.lag)))


def write(path: Path, rig: Rig, found: Readings, random: np.random.Generator) -> Path:
    """The file of a record with its noise; its name ends as its form does."""
    if rig.pose_rate is not None:
        return _topics(path.with_suffix(".mcap"), rig, found, random)
    time, depth = found.time[::FINE], found.depth[::FINE]
    force = _force(rig, time, found.force[::FINE], random)
    height = -depth + rig.height_noise * random.standard_normal(len(time))
    if rig.channel == "rounded":
        force, height = np.round(force, 2), np.round(height, 6)
    of_force, of_way = (_FACTORS[unit] for unit in rig.units)
    names = [f"force ({rig.units[0]})", f"height ({rig.units[1]})"]
    columns = [of_force * force, of_way * height]
    if rig.speed_noise is not None:
        names.append(f"velocity ({rig.units[1]}/s)")
        speed = -np.gradient(found.depth, found.time)[::FINE]
        columns.append(of_way * (speed + rig.speed_noise * random.standard_normal(len(time))))
    if found.extra is not None:
        names.append(f"deflection ({rig.units[1]})")
        columns.append(of_way * found.extra[::FINE])
    path = path.with_suffix(".csv")
    head = ",".join(["time (s)", *names])
    np.savetxt(path, np.column_stack([time, *columns]), delimiter=",", header=head, comments="", fmt="%.9g")
    return path


def _force(rig: Rig, time: Column, force: Column, random: np.random.Generator) -> Column:
    """The force with the noise of its channel."""
    white = random.standard_normal(len(time))
    if rig.channel == "low-pass":
        keep = float(np.exp(-2 * np.pi * 20.0 / rig.rate))
        white = lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], white, zi=[keep * random.standard_normal()])[0]
    force = force + rig.noise * white
    if rig.channel == "hum":
        force = force + 15e-3 * np.sin(2 * np.pi * 50.0 * time + random.uniform(0, 2 * np.pi))
    if rig.channel == "held":  # a sensor of a fifth of the rate
        force = np.repeat(force[::5], 5)[: len(force)]
    return np.asarray(force)


def _topics(path: Path, rig: Rig, found: Readings, random: np.random.Generator) -> Path:
    """Two topics, each with stamps of its own clock ticks."""
    from mcap_ros2.writer import Writer

    end = float(found.time[-1])
    times = {
        "force": np.arange(0.0, end, 1.0 / rig.rate) + 1e-3 * random.random() / rig.rate,
        "pose": np.arange(0.0, end, 1.0 / (rig.pose_rate or rig.rate)) + random.random() / (rig.pose_rate or 1.0),
    }
    times = {name: column[column < end] for name, column in times.items()}
    force = np.interp(times["force"], found.time, found.force)
    force = force + rig.noise * random.standard_normal(len(force))
    height = -np.interp(times["pose"], found.time, found.depth)
    height = height + rig.height_noise * random.standard_normal(len(height))
    rows = [(t, "/wrench", f) for t, f in zip(times["force"], force, strict=True)]
    rows += [(t, "/pose", h) for t, h in zip(times["pose"], height, strict=True)]
    begin = 1_700_000_000 * 10**9
    with path.open("wb") as file, Writer(file) as writer:
        schemas = {
            "/wrench": writer.register_msgdef("geometry_msgs/msg/WrenchStamped", _WRENCH),
            "/pose": writer.register_msgdef("geometry_msgs/msg/PoseStamped", _POSE),
        }
        for instant, topic, value in sorted(rows):
            stamp = begin + round(1e9 * float(instant))
            header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": "tool0"}
            vector = {"x": 0.0, "y": 0.0, "z": float(value)}
            body = {"wrench": {"force": vector, "torque": {"x": 0.0, "y": 0.0, "z": 0.0}}}
            if topic == "/pose":
                body = {"pose": {"position": vector, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}}
            writer.write_message(topic, schemas[topic], {"header": header, **body}, stamp, stamp)
    return path
