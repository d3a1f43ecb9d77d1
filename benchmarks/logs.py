"""How fast logs are read and replayed: the columnar reader against the official one, and against the disk and zstd.

Ten minutes of a 1 kHz wrench and a 500 Hz pose, 900 000 messages. Every way is run in turn, several times over, in one
process; medians of processor time are printed, and ratios, since the wall clock of a busy machine says little. A replay
is `palpate run` from the log to the result through EKF and AFUKF-8 on DR, reading, checking and compiling included, and
says what its compiling took. ``python benchmarks/logs.py [--seconds 600] [--rounds 5]``
"""

import argparse
import json
import os
import shutil
import statistics
import struct
import tempfile
import time
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from palpate_devices.mcap_replay import McapReplay
from palpate_devices.messages import POSE, WRENCH, pack
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline, start_tracks
from palpate_records.mcap import mcap_records as records

STEP = 1_000_000  # [ns]


def numbers(seconds):
    """Stamps and numbers of wrench and pose."""
    random = np.random.default_rng(0)
    stamps = 1_700_000_000 * 10**9 + np.arange(seconds * 1000) * STEP
    return {
        "/ft/wrench": (WRENCH, stamps, random.normal(size=(len(stamps), 6))),
        "/tcp/pose": (POSE, stamps[::2], random.normal(size=(len(stamps[::2]), 7))),
    }


def write(path, data, encoding, compression=CompressionType.ZSTD):
    """One log, in the order of time."""
    with path.open("wb") as file:
        writer = Writer(file, compression=compression)
        writer.start(profile="ros2", library="benchmark")
        entries = []
        for topic, (kind, stamps, values) in data.items():
            if encoding == "cdr":
                schema = writer.register_schema(kind.name, "ros2msg", kind.definition.encode())
                messages = pack(stamps, "ft_sensor0_wrench", values)
            else:
                schema = writer.register_schema(kind.name, "jsonschema", b"{}")
                messages = [
                    json.dumps({"stamp": s, **dict(zip(kind.fields, row, strict=True))}).encode()
                    for s, row in zip(stamps.tolist(), values.tolist(), strict=True)
                ]
            channel = writer.register_channel(topic, encoding, schema)
            entries += [(s, channel, m) for s, m in zip(stamps.tolist(), messages, strict=True)]
        for stamp, channel, message in sorted(entries, key=lambda entry: entry[0]):
            writer.add_message(channel, stamp, message, stamp)
        writer.finish()
    return path


def plain_json(path):
    """The plain reader of the mcap library, and json."""
    found = {}
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
            fields = json.loads(message.data)
            found.setdefault(channel.topic, []).append(tuple(fields.values())[1:])
    return sum(float(np.array(rows).sum()) for rows in found.values())


def plain_columns(path):
    """The plain reader of the mcap library, and struct at the places where these messages have their numbers."""
    kinds = {"/ft/wrench": WRENCH, "/tcp/pose": POSE}
    layouts = {topic: struct.Struct(f"<{len(kind.fields)}d") for topic, kind in kinds.items()}
    found = {}
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
            layout, data = layouts[channel.topic], message.data
            found.setdefault(channel.topic, []).append(layout.unpack_from(data, len(data) - layout.size))
    return sum(float(np.array(rows).sum()) for rows in found.values())


def columnar(path):
    """The device, as a pipeline reads it."""
    total = 0.0
    with McapReplay(file=path).connect(0) as link:
        for batch in link.batches():
            total += float(batch.values.sum())
    return total


def decompressed(path):
    """The file read and every chunk decompressed and checked, nothing more."""
    size, unpacker = 0, records.Unpacker()
    with path.open("rb") as file:
        file.seek(len(records.MAGIC))
        while True:
            opcode, length = records.RECORD.unpack(file.read(9))
            content = file.read(length)
            if opcode == records.CHUNK:
                size += len(records.open_chunk(content, unpacker).data)
            elif opcode == records.DATA_END:
                return size


PIPELINE = """
[run]
estimates_interval = "{interval}"
[device.log]
type = "mcap-replay"
file = "{log}"
[alignment]
force = {{ channel = "log.wrench.z", delay = "0 ms", uncertainty = "0.1 ms" }}
position = "log.pose.z"
tip_mass = "140 g"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
poisson = 0.5
[estimator.ekf]
type = "ekf"
[estimator.afukf]
type = "afukf"
"""


def press(seconds, elasticity=112.5e3, viscosity=362.0, radius=0.005):
    """Stamps and numbers of a press that swings at 2 Hz, as the paper's specimen S2 answers it."""
    data = numbers(seconds)
    time_s = np.arange(seconds * 1000) / 1000
    ramp = np.clip((time_s - 1.5) / 1.0, 0, 1)
    height = 0.001 * (1 - ramp) - ramp * (0.004 + 0.001 * np.sin(4 * np.pi * time_s))
    depth = np.maximum(-height, 0.0)
    force = 16 / 9 * elasticity * np.sqrt(radius) * depth**1.5
    force -= 8 * viscosity * np.sqrt(radius * depth) * np.gradient(height, time_s)
    for (_, _, values), truth, noise in zip(data.values(), (force, height[::2]), (0.05, 5e-6), strict=True):
        values[:] *= noise
        values[:, 2] += truth
    return data


def replay(folder, log, kernel, interval):
    """One run, from the pipeline's text to the result: processor time [s], of it compiling, and the clock's."""
    os.environ["PALPATE_KERNEL"] = kernel
    path = folder / "pipeline.toml"
    path.write_text(PIPELINE.format(log=log, interval=interval))
    before = time.process_time()
    start_tracks(load_pipeline(path))
    compiling = time.process_time() - before
    shutil.rmtree(folder / "out", ignore_errors=True)
    before, began = time.process_time(), time.perf_counter()
    run_pipeline(load_pipeline(path), folder / "out")
    return time.process_time() - before, compiling, time.perf_counter() - began


def replays(arguments, folder):
    """Replays in turn: times real time, with and without compiling, by the processors' time and by the clock."""
    log = write(folder / "press.mcap", press(arguments.seconds), "cdr")
    cells = [(kernel, interval) for kernel in ("llvm", "vm") for interval in ("10 ms", "1 s")]
    found = {cell: [] for cell in cells}
    for _ in range(arguments.rounds + 1):
        for cell in cells:
            found[cell].append(replay(folder, log, *cell))
    print(
        "replay of EKF and AFUKF-8 on DR: kernel, rows of the table; CPU s, of it compiling; times real time, without; "
        "s by the clock, times real time"
    )
    for (kernel, interval), times in found.items():
        whole, compiling, clock = np.median(times[1:], axis=0)  # the first imports
        ratio, bare, seen = arguments.seconds / np.array([whole, whole - compiling, clock])
        print(
            f"{kernel:5s} every {interval:6s} {whole:8.3f} {compiling:8.3f} {ratio:8.0f} {bare:8.0f} "
            f"{clock:8.3f} {seen:8.0f}"
        )


def main():
    """Write the logs, time every way in turn, print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    data = numbers(arguments.seconds)
    count = sum(len(stamps) for _, stamps, _ in data.values())
    with tempfile.TemporaryDirectory() as folder:
        logs = {
            "json": write(Path(folder) / "json.mcap", data, "json"),
            "zstd": write(Path(folder) / "zstd.mcap", data, "cdr"),
            "lz4": write(Path(folder) / "lz4.mcap", data, "cdr", CompressionType.LZ4),
            "none": write(Path(folder) / "none.mcap", data, "cdr", CompressionType.NONE),
        }
        ways = {
            "mcap + json": lambda: plain_json(logs["json"]),
            "mcap + struct into columns": lambda: plain_columns(logs["zstd"]),
            "read and decompress, zstd": lambda: decompressed(logs["zstd"]),
            "columnar, zstd": lambda: columnar(logs["zstd"]),
            "columnar, lz4": lambda: columnar(logs["lz4"]),
            "columnar, none": lambda: columnar(logs["none"]),
        }
        seconds = {name: [] for name in ways}
        sums = {}
        for _ in range(arguments.rounds):
            for name, way in ways.items():
                before = time.process_time()
                sums[name] = way()
                seconds[name].append(time.process_time() - before)
        replays(arguments, Path(folder))
    for plain in ("mcap + json", "mcap + struct into columns"):
        assert np.isclose(sums["columnar, zstd"], sums[plain], rtol=1e-9)
    base = statistics.median(seconds["mcap + struct into columns"])
    print(f"{count} messages, {arguments.rounds} rounds; median CPU s, messages/s, times as fast as mcap + struct")
    for name, times in seconds.items():
        median = statistics.median(times)
        print(f"{name:28s} {median:8.3f} {count / median:12.0f} {base / median:8.1f}")


if __name__ == "__main__":
    main()
