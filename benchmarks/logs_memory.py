"""How much memory the replay of a large log takes: ``python benchmarks/logs_memory.py [--gigabytes 2] [--export]``.

The log is made of one chunk, written over and over, and has no summary, so that it is passed twice: once for its
channels, once for its numbers. With ``--export`` two smaller logs are written as tables, too.
"""

import argparse
import resource
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from logs import numbers, write
from mcap.writer import CompressionType
from palpate_devices.mcap_replay import McapReplay
from palpate_records.mcap import mcap_records as records


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


def exported(folder, kind):
    """Export a log of 900 000 messages, and one of three times as many, each in a process of its own."""
    for seconds in (600, 1800):
        log = write(folder / f"{seconds}.mcap", numbers(seconds), "cdr", CompressionType.NONE)
        out = folder / f"{seconds}.{kind}"
        # A child's ru_maxrss begins at what its parent had; the high-water mark of its own memory does not.
        code = (
            "import sys; from pathlib import Path; from palpate_logs.commands.export import export\n"
            "export(Path(sys.argv[1]), Path(sys.argv[2]), None)\n"
            "print(next(line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')))"
        )
        words = [sys.executable, "-c", code, str(log), str(out)]
        done = subprocess.run(words, capture_output=True, text=True, check=True)
        print(
            f"export of {log.stat().st_size / 2**20:.0f} MiB to {out.stat().st_size / 2**20:.0f} MiB of {kind}: "
            f"largest memory {int(done.stdout.split()[-1]) / 1024:.0f} MiB"
        )


def main():
    """Make the log, replay it, print the largest memory that the process ever had."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--gigabytes", type=float, default=2.0)
    parser.add_argument("--export", choices=["csv", "parquet", "npz"])
    arguments = parser.parse_args()
    size = int(arguments.gigabytes * 2**30)
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
        if arguments.export:
            exported(Path(folder), arguments.export)


if __name__ == "__main__":
    main()
