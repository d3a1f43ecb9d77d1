"""What large work takes: time, processor time, memory of all processes (PSS), and what is said while it goes on.

    python benchmarks/loads.py mcap [--gigabytes 4]      replay, info, export and recover of a log
    python benchmarks/loads.py csv [--rows 1e7]          estimate, info and export of a table
    python benchmarks/loads.py sweep [--settings 1000]   one short press with so many settings
    python benchmarks/loads.py raster [--sites 1e4]      a simulated raster, its map and its lumps
    python benchmarks/loads.py day [--hours 24]          so long a record, and a 24th of it on the simulated rig

Every command runs as it does under nohup or in a job of a cluster: without a terminal, its standard error into a pipe
whose lines are timed. Memory is looked at once a second. `--only COMMAND` (can be repeated) leaves out the others,
`--folder` says where gigabytes may be written; all of it is removed in the end.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import itertools
import os
import resource
import shutil
import struct
import subprocess
import sys
import tempfile
import threading
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.writer import Writer
from numpy.typing import NDArray
from palpate import Floats
from palpate_devices.messages import POSE, WRENCH, pack
from palpate_records.mcap import mcap_records as records
from soak import Look

PALPATE = [sys.executable, "-c", "from palpate_engine.cli import main; main()"]
PIPELINES = Path(__file__).parents[1] / "pipelines"
Place = tuple[int, int]  # [bytes] of a message in its row, and of its header's stamp
BLOCK = 20.0  # [s] of a record that are made at a time
RADIUS, ELASTICITY, VISCOSITY = 5e-3, 112.5e3, 362.0  # [m], [Pa], [Pa s]

READING = """
[model.dr]
type = "dimensionality-reduction"
[model.dr.indenter]
type = "sphere"
radius = "5 mm"

[estimator.ekf]
type = "ekf"

[estimator.kinematic]
type = "kinematic-ekf"

[alignment]
force = { channel = "log.FORCE", uncertainty = "0.1 ms" }
position = "log.HEIGHT"
tip_mass = "140 g"
"""


@dataclass
class Watched:
    """What one command took."""

    name: str
    code: int = 0
    wall: float = 0.0  # [s]
    cpu: float = 0.0  # [s] of it and its children
    memory: list[Look] = field(default_factory=list)
    lines: list[tuple[float, str]] = field(default_factory=list)  # [s] of standard error

    def row(self) -> str:
        """One line of the table: memory at most, and in the second and last quarter of the time."""
        held = np.array([look.share / 1024 for look in self.memory] or [0.0])
        quarters = [float(np.median(part)) if len(part) else float("nan") for part in np.array_split(held, 4)]
        times = [0.0, *(at for at, _ in self.lines), self.wall]
        silent = max(b - a for a, b in itertools.pairwise(times))
        return (
            f"{self.name:22}{self.code:5}{self.wall:9.1f}{self.cpu:9.1f}{held.max():9.0f}{quarters[1]:9.0f}"
            f"{quarters[3]:9.0f}{len(self.lines):7}{silent:8.1f}"
        )


HEADING = (
    f"{'command':22}{'code':>5}{'wall s':>9}{'CPU s':>9}{'MiB most':>9}{'2nd qu.':>9}{'4th qu.':>9}"
    f"{'lines':>7}{'silent':>8}"
)


def watched(name: str, *words: object, code: int = 0) -> Watched:
    """Run a command of palpate without a terminal, look at it until it ends, and print its row."""
    found, before = Watched(name), resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.monotonic()
    job = subprocess.Popen(
        [*PALPATE, *map(str, words)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PALPATE_PLUGINS": "off"},
    )

    def listen() -> None:
        assert job.stderr is not None
        for line in job.stderr:
            found.lines.append((time.monotonic() - began, line.rstrip()))

    listener = threading.Thread(target=listen)
    listener.start()
    while job.poll() is None:
        found.memory.append(Look.at(job.pid, time.monotonic() - began))
        with contextlib.suppress(subprocess.TimeoutExpired):
            job.wait(1.0)
    found.wall = time.monotonic() - began
    listener.join()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    found.cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    found.code = job.returncode
    print(found.row(), flush=True)
    if found.code != code:
        print("\n".join(line for _, line in found.lines[-20:]), flush=True)
    elif found.lines:
        print(f"    {found.lines[-1][1][:160]}", flush=True)
    return found


def press(time_: Floats, noise: np.random.Generator) -> tuple[Floats, Floats]:
    """Force [N] and height [m] of a tip that palpates for hours: a second of air, then a sine of 2 Hz around 4 mm."""
    ramp = np.clip((time_ - 1.0) / 0.5, 0.0, 1.0)
    swell = ramp**2 * (3 - 2 * ramp)
    omega = 4 * np.pi
    depth = swell * (6e-3 + 1e-3 * np.sin(omega * time_)) - 2e-3
    rate = swell * 1e-3 * omega * np.cos(omega * time_)
    inside = np.maximum(depth, 0.0)
    force = 16 / 9 * ELASTICITY * RADIUS**0.5 * inside**1.5 + 8 * VISCOSITY * np.sqrt(RADIUS * inside) * rate
    return force + 0.02 * noise.standard_normal(len(time_)), -depth + 5e-6 * noise.standard_normal(len(time_))


def written(path: Path, seconds: float, size: float, rate: float) -> None:
    """A log of a wrench and a pose [Hz], so long [s] or of so many bytes, in chunks of a block each, not compressed.

    The first block is written by the `mcap` library; every further one is the second again, with later stamps.
    """
    begin, step, count = 1_700_000_000 * 10**9, round(1e9 / rate), round(rate * BLOCK)
    noise = np.random.default_rng(1)
    with path.open("wb") as file:
        file.write(records.MAGIC)
        for number in itertools.count():
            stamps = begin + (number * count + np.arange(count)) * step
            if number < 2:
                force, height = press((stamps - begin) / 1e9, noise)
                wrench, pose = 0.02 * noise.standard_normal((count, 6)), np.zeros((count, 7))
                wrench[:, 2], pose[:, 2], pose[:, 6] = force, height, 1.0
                head, rows, places = laid_out(stamps, wrench, pose)
                if not number:
                    file.write(head)
            for at, stamp in places:
                for offset in (at + 15, at + 23):
                    rows[:, offset : offset + 8] = stamps[:, None].view(np.uint8)
                rows[:, stamp : stamp + 4] = (stamps // 10**9).astype("<i4")[:, None].view(np.uint8)
                rows[:, stamp + 4 : stamp + 8] = (stamps % 10**9).astype("<u4")[:, None].view(np.uint8)
            data = rows.tobytes()
            chunk = struct.pack("<QQQIIQ", stamps[0], stamps[-1], len(data), zlib.crc32(data), 0, len(data))
            file.write(struct.pack("<BQ", records.CHUNK, len(chunk) + len(data)) + chunk)
            file.write(data)
            if (number + 1) * BLOCK >= seconds or file.tell() >= size:
                break
        file.write(struct.pack("<BQI", records.DATA_END, 4, 0))
        file.write(struct.pack("<BQQQI", records.FOOTER, 20, 0, 0, 0) + records.MAGIC)
    made = (number + 1) * BLOCK
    print(
        f"log of {path.stat().st_size / 2**30:.2f} GiB, {made / 3600:.2f} h, {2 * made * rate:.3g} messages", flush=True
    )


def laid_out(stamps: NDArray[np.int64], wrench: Floats, pose: Floats) -> tuple[bytes, NDArray[np.uint8], list[Place]]:
    """Definitions; a wrench and a pose in each row (n, bytes); where each of them begins, and where its header's stamp.

    A message's record is its opcode, length (8 bytes), channel (2), sequence (4), log and publish time (8 each), data.
    """
    whole = io.BytesIO()
    writer = Writer(whole, use_chunking=False)
    writer.start(profile="ros2", library="benchmark")
    channels = []
    for topic, kind in (("/ft/wrench", WRENCH), ("/tcp/pose", POSE)):
        schema = writer.register_schema(kind.name, "ros2msg", kind.definition.encode())
        channels.append(writer.register_channel(topic, "cdr", schema))
    messages = pack(stamps, "tool0", wrench), pack(stamps, "base", pose)
    for stamp, *both in zip(stamps.tolist(), *messages, strict=True):
        for channel, message in zip(channels, both, strict=True):
            writer.add_message(channel, stamp, message, stamp)
    writer.finish()
    raw, sizes = whole.getvalue(), [31 + len(column[0]) for column in messages]
    begin = len(records.MAGIC)
    while raw[begin] != records.MESSAGE:
        begin += 9 + records.RECORD.unpack_from(raw, begin)[1]
    rows = np.frombuffer(raw[begin : begin + len(stamps) * sum(sizes)], np.uint8).reshape(len(stamps), -1).copy()
    return raw[len(records.MAGIC) : begin], rows, [(0, 35), (sizes[0], sizes[0] + 35)]


def mcap(options: argparse.Namespace) -> None:
    """A log of a 1 kHz wrench and pose: estimated, looked at, exported, recovered."""
    path = options.folder / "log.mcap"
    written(path, np.inf, options.gigabytes * 2**30, 1000.0)
    pipeline = reading(path)
    each(
        {
            "run": lambda: watched("run", "run", pipeline, "--out", options.folder / "run"),
            "info": lambda: watched("info", "info", path),
            "suggest": lambda: watched("info -o", "info", path, "-o", options.folder / "suggested.toml"),
            "parquet": lambda: watched("export .parquet", "log", "export", path, "-o", options.folder / "x.parquet"),
            "csv": lambda: watched("export .csv", "log", "export", path, "-o", options.folder / "x.csv"),
            "recover": lambda: recovered(path, options.folder / "damaged.mcap", options.folder),
        },
        options,
    )


def reading(path: Path) -> Path:
    """A pipeline that estimates from such a log."""
    signals = (
        '[device.log.signals]\nforce = { topic = "/ft/wrench", field = "wrench.force.z", unit = "N" }\n'
        'z = { topic = "/tcp/pose", field = "pose.position.z", unit = "m" }\n'
    )
    text = READING.replace("FORCE", "wrench.force").replace("HEIGHT", "pose.z")
    head = (
        f'[run]\nname = "log"\nestimates_interval = "1 s"\n[device.log]\ntype = "mcap-replay"\nfile = "{path.name}"\n'
    )
    pipeline = path.with_suffix(".toml")
    pipeline.write_text(head + signals + text)
    return pipeline


def recovered(path: Path, damaged: Path, folder: Path) -> None:
    """`recover` of the log with a byte changed in its middle and its last tenth cut off."""
    path.rename(damaged)  # a copy would need as much again
    with damaged.open("r+b") as file:
        file.seek(damaged.stat().st_size // 2)
        byte = file.read(1)
        file.seek(-1, os.SEEK_CUR)
        file.write(bytes([byte[0] ^ 1]))
        file.truncate(damaged.stat().st_size * 9 // 10)
    watched("recover", "log", "recover", damaged, "-o", folder / "whole.mcap")


def csv(options: argparse.Namespace) -> None:
    """A table of time, force and height at 500 Hz."""
    rows, folder = int(options.rows), options.folder
    noise, path, began = np.random.default_rng(1), folder / "log.csv", time.monotonic()
    with path.open("w") as file:
        file.write("time_s,force_N,height_m\n")
        for first in range(0, rows, 50_000):
            times = np.arange(first, min(first + 50_000, rows)) / 500.0
            force, height = press(times, noise)
            np.savetxt(file, np.column_stack([times, force, height]), "%.3f,%.5f,%.8f")
    print(f"table of {path.stat().st_size / 2**20:.0f} MiB, {rows} rows, in {time.monotonic() - began:.0f} s")
    pipeline = folder / "csv.toml"
    text = READING.replace("FORCE", "force").replace("HEIGHT", "height")
    pipeline.write_text(
        '[run]\nname = "table"\n[device.log]\ntype = "csv-replay"\nfile = "log.csv"\n'
        'time = { column = "time_s", unit = "s" }\n[device.log.columns]\n'
        'force = { column = "force_N", unit = "N" }\nheight = { column = "height_m", unit = "m" }\n' + text
    )
    each(
        {
            "run": lambda: watched("run", "run", pipeline, "--out", folder / "run"),
            "info": lambda: watched("info", "info", path),
            "suggest": lambda: watched("info --suggest", "info", path, "-o", folder / "suggested.toml"),
            "parquet": lambda: watched("export .parquet", "log", "export", path, "-o", folder / "x.parquet"),
        },
        options,
    )


def swept(folder: Path, count: int) -> Path:
    """The file of a sweep: a second of contact with one filter, so many settings of its noise."""
    text = (PIPELINES / "filters.toml").read_text().replace('duration = "10 s"', 'duration = "1 s"')
    text = text.partition("[estimator.kinematic]")[0]
    stds = ", ".join(f"{0.02 + 0.06 * i / count:.6f}" for i in range(count))
    pipeline = folder / f"sweep{count}.toml"
    pipeline.write_text(f'{text}\n[sweep]\n"estimator.ekf.force_std" = [{stds}]\n')
    return pipeline


def sweep(options: argparse.Namespace) -> None:
    """Runs and the same again."""
    count, folder = int(options.settings), options.folder
    pipeline, out = swept(folder, count), folder / "sweep"
    each(
        {
            "sweep": lambda: watched(f"sweep of {count}", "sweep", pipeline, "--out", out),
            "resumed": lambda: watched("the same again", "sweep", pipeline, "--out", out),
        },
        options,
    )


def raster(options: argparse.Namespace) -> None:
    """Lines of 200 mm, 2 mm apart, at 4 mm/s: a site each millimetre."""
    lines, folder = max(int(options.sites) // 200, 2), options.folder
    text = (PIPELINES / "raster.toml").read_text()
    text = text.replace('size = ["60 mm", "40 mm"]', f'size = ["200 mm", "{2 * (lines - 1)} mm"]')
    text = text.replace('pitch = "5 mm"', 'pitch = "2 mm"')
    text = text.replace('size = ["80 mm", "60 mm"]', f'size = ["220 mm", "{2 * lines + 20} mm"]')
    pipeline, run = folder / "raster.toml", folder / "raster"
    pipeline.write_text(text)
    each(
        {
            "run": lambda: watched(f"run, {lines} lines", "run", pipeline, "--out", run),
            "map": lambda: watched("map", "map", run),
            "average": lambda: watched("map, average", "map", run, "--method", "average"),
            "lumps": lambda: watched("lumps", "map", "lumps", run),
            "report": lambda: watched("report", "report", run),
        },
        options,
    )


def day(options: argparse.Namespace) -> None:
    """Hours of a wrench and a pose of 500 Hz through two filters; and hours on the simulated rig, recorded."""
    path, folder = options.folder / "log.mcap", options.folder

    def estimated() -> None:
        written(path, 3600 * options.hours, np.inf, 500.0)
        watched(f"run, {options.hours:g} h of log", "run", reading(path), "--out", folder / "run")
        path.unlink()

    def recorded() -> None:
        hours = options.hours / 24
        watched(
            f"rig and log, {hours:g} h",
            *("run", PIPELINES / "filters.toml", "--out", folder / "rig"),
            *("--set", f"trajectory.press.duration={3600 * hours} s", "--set", "run.estimates_interval=1 s"),
        )

    each({"estimated": estimated, "recorded": recorded}, options)


def each(commands: dict[str, Callable[[], object]], options: argparse.Namespace) -> None:
    """Those that are requested, one after the other."""
    if unknown := set(options.only or ()) - set(commands):
        sys.exit(f"--only {', '.join(sorted(unknown))}: there are {', '.join(commands)}")
    for name, command in commands.items():
        if not options.only or name in options.only:
            command()


def main() -> None:
    """Parse, make, watch."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    kinds = parser.add_subparsers(dest="kind", required=True)
    sizes = {mcap: ("gigabytes", 4.0), csv: ("rows", 1e7), sweep: ("settings", 1e3), raster: ("sites", 1e4)}
    for function, (name, size) in {**sizes, day: ("hours", 24.0)}.items():
        kind = kinds.add_parser(function.__name__, help=function.__doc__)
        kind.add_argument(f"--{name}", type=float, default=size)
        kind.add_argument("--only", action="append", metavar="COMMAND")
        kind.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()), help="where gigabytes may lie")
        kind.set_defaults(function=function)
    options = parser.parse_args()
    options.folder = Path(tempfile.mkdtemp(prefix="palpate-loads-", dir=options.folder))
    try:
        print(HEADING, flush=True)
        options.function(options)
    finally:
        shutil.rmtree(options.folder)


if __name__ == "__main__":
    main()
