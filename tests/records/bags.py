"""Logs made for the tests: messages written by the field, and bags as ROS 2 writes them."""

import sqlite3
import struct

import numpy as np


class Cdr:
    """A CDR message, written field by field."""

    def __init__(self, big=False):
        self.order = ">" if big else "<"
        self.data = bytearray(b"\0\0\0\0" if big else b"\0\1\0\0")

    def put(self, code, *numbers):
        for number in numbers:
            size = struct.calcsize(code)
            self.data += b"\0" * (-(len(self.data) - 4) % size) + struct.pack(self.order + code, number)
        return self

    def text(self, words):
        raw = words.encode() + b"\0"
        self.put("I", len(raw))
        self.data += raw
        return self

    def header(self, stamp, frame):
        return self.put("i", stamp // 10**9).put("I", stamp % 10**9).text(frame)

    def __bytes__(self):
        return bytes(self.data)


def array_message(numbers, big=False):
    """std_msgs/msg/Float64MultiArray without dimensions."""
    return bytes(Cdr(big).put("I", 0, 0, len(numbers)).put("d", *numbers))


def wrench_message(stamp, frame, numbers):
    """geometry_msgs/msg/WrenchStamped."""
    return bytes(Cdr().header(stamp, frame).put("d", *numbers))


def joints_message(stamp, names, positions, velocities=()):
    """sensor_msgs/msg/JointState without efforts."""
    message = Cdr().header(stamp, "").put("I", len(names))
    for name in names:
        message.text(name)
    for numbers in (positions, velocities, ()):
        message.put("I", len(numbers)).put("d", *numbers)
    return bytes(message)


def transforms_message(transforms):
    """tf2_msgs/msg/TFMessage of (stamp, parent, child, translation and rotation)."""
    message = Cdr().put("I", len(transforms))
    for stamp, parent, child, numbers in transforms:
        message.header(stamp, parent).text(child).put("d", *numbers)
    return bytes(message)


def write_bag(path, topics):
    """A rosbag2 database of topics: (name, type, [(stamp, message)])."""
    with sqlite3.connect(path) as database:
        database.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
            "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)"
        )
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, "
            "data BLOB NOT NULL)"
        )
        for number, (name, kind, messages) in enumerate(topics, 1):
            database.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')", (number, name, kind))
            rows = [(number, stamp, data) for stamp, data in messages]
            database.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
    database.close()
    return path


def press(seconds=4.0, rate=500.0):
    """Time [s], height [m], velocity [m/s] and force [N] of a press that begins in air, swings at 2 Hz, and ends."""
    time = np.arange(int(seconds * rate)) / rate
    ramp = np.clip((time - 1.0) / 0.5, 0.0, 1.0)
    depth = ramp * (0.004 + 0.001 * np.sin(4 * np.pi * (time - 1.0))) - 0.001 * (1.0 - ramp)
    rate_of = np.gradient(depth, time)
    force = np.where(depth > 0, 1.2e4 * np.maximum(depth, 0.0) ** 1.5 * 1.0, 0.0)
    noise = np.random.default_rng(3).standard_normal((3, len(time)))
    return time, -depth + 1e-6 * noise[0], -rate_of + 1e-4 * noise[1], force + 0.02 * noise[2]
