"""How much memory the replay of a large log takes: ``python benchmarks/logs_memory.py [--gigabytes 2]``.

The log is made of one chunk, written over and over, and has no summary, so that it is passed twice: once for its
channels, once for its numbers.
"""

import argparse
import resource
import struct
import tempfile
import time
from pathlib import Path

from logs import numbers, write
from mcap.writer import CompressionType
from palpate_devices.logs import mcap_records as records
from palpate_devices.mcap_replay import McapReplay


def repeated(source, target, size):
    """The data of one log, again and again, up to a size [bytes]."""
    raw = source.read_bytes()
    position, data = len(records.MAGIC), []
    while True:
        opcode, length = records.RECORD.unpack_from(raw, position)
        if opcode == records.DATA_END:
            break
        data.append(raw[position : position + 9 + length])
        position += 9 + length
    block = b"".join(data[1:])
    with target.open("wb") as file:
        file.write(records.MAGIC + data[0])
        while file.tell() < size:
            file.write(block)
        file.write(struct.pack("<BQI", records.DATA_END, 4, 0))
        file.write(struct.pack("<BQQQI", records.FOOTER, 20, 0, 0, 0) + records.MAGIC)


def main():
    """Make the log, replay it, print the largest memory that the process ever had."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--gigabytes", type=float, default=2.0)
    size = int(parser.parse_args().gigabytes * 2**30)
    with tempfile.TemporaryDirectory() as folder:
        small = write(Path(folder) / "small.mcap", numbers(20), "cdr", CompressionType.NONE)
        large = Path(folder) / "large.mcap"
        repeated(small, large, size)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        began, count = time.process_time(), 0
        with McapReplay(file=large).connect(0) as link:
            for batch in link.batches():
                count += len(batch.time)
        spent = time.process_time() - began
        after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"{large.stat().st_size / 2**30:.2f} GiB, {count} messages, {spent:.1f} CPU s")
        print(f"largest memory: {before:.0f} MiB before, {after:.0f} MiB after")


if __name__ == "__main__":
    main()
