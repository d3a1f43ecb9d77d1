"""How fast logs are read: the columnar reader against the plain one, and against the disk and zstd alone.

Ten minutes of a 1 kHz wrench and a 500 Hz pose, 900 000 messages. Every way is run in turn, several times over, in one
process; medians of processor time are printed, and ratios, since the wall clock of a busy machine says little.
``python benchmarks/logs.py [--seconds 600] [--rounds 5]``
"""

import argparse
import json
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from palpate_devices.logs import mcap_records as records
from palpate_devices.mcap_replay import McapReplay
from palpate_devices.messages import POSE, WRENCH, pack

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
    assert np.isclose(sums["columnar, zstd"], sums["mcap + json"], rtol=1e-9)
    base = statistics.median(seconds["mcap + json"])
    print(
        f"{count} messages, {arguments.rounds} rounds; columns: median CPU s, messages/s, times as fast as mcap + json"
    )
    for name, times in seconds.items():
        median = statistics.median(times)
        print(f"{name:28s} {median:8.3f} {count / median:12.0f} {base / median:8.1f}")


if __name__ == "__main__":
    main()
