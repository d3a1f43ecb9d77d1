"""What large work takes: time, processor time, memory of all processes (PSS), and what is said while it goes on.

    python benchmarks/loads.py mcap [--gigabytes 4]      replay, info, export and recover of a log
    python benchmarks/loads.py csv [--rows 1e7]          estimate, info and export of a table
    python benchmarks/loads.py sweep [--settings 1000]   one short press with so many settings
    python benchmarks/loads.py raster [--sites 1e4]      a simulated raster, its map and its lumps
    python benchmarks/loads.py day [--hours 24]          the simulated rig, two filters and a log, as fast as it goes

Every command runs as it does under nohup or in a job of a cluster: without a terminal, its standard error into a pipe
whose lines are timed. Memory is looked at once a second. `--only COMMAND` (can be repeated) leaves out the others,
`--folder` says where gigabytes may be written; all of it is removed in the end.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from palpate import Batch, Channel, Floats, Run, Stream
from palpate_devices.mcap_sink import McapSink
from soak import memory_of

PALPATE = [sys.executable, "-c", "from palpate.cli import main; main()"]
PIPELINES = Path(__file__).parents[1] / "pipelines"
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
    memory: list[tuple[float, int, int]] = field(default_factory=list)  # [s], processes, [kB]
    lines: list[tuple[float, str]] = field(default_factory=list)  # [s] of standard error

    def row(self) -> str:
        """One line of the table: memory at most, and in the second and last quarter of the time."""
        held = np.array([kilobytes / 1024 for _, _, kilobytes in self.memory] or [0.0])
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
        found.memory.append((time.monotonic() - began, *memory_of(job.pid)))
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


def mcap(options: argparse.Namespace) -> None:
    """A log of a 1 kHz wrench and a 500 Hz pose, written by the sink that records runs."""
    size, folder = options.gigabytes * 2**30, options.folder
    wrench = Stream("wrench", tuple(Channel(n, "N") for n in ("x", "y", "z", "tx", "ty", "tz")), 1000.0, "wrench")
    tip = Stream("tip", tuple(Channel(n, "m") for n in ("x", "y", "z")), 500.0)
    noise, path, begin = np.random.default_rng(1), folder / "log.mcap", 1_700_000_000 * 10**9
    seconds, began = 0.0, time.monotonic()
    with McapSink().open(Run(folder, {"rig": (wrench, tip)}, {}, {}, {})) as writer:
        while path.stat().st_size < size:
            stamps = begin + round(seconds * 1e9) + np.arange(round(1000 * BLOCK)) * 1_000_000
            force, height = press((stamps - begin) / 1e9, noise)
            values = 0.02 * noise.standard_normal((len(stamps), 6))
            values[:, 2] = force
            writer.batch("rig", Batch("wrench", stamps, stamps, values))
            places = np.column_stack([np.zeros((len(stamps) // 2, 2)), height[::2]])
            writer.batch("rig", Batch("tip", stamps[::2], stamps[::2], places))
            seconds += BLOCK
    made = path.stat().st_size / 2**30
    print(f"log of {made:.2f} GiB, {seconds:.0f} s, {1500 * seconds:.3g} messages, in {time.monotonic() - began:.0f} s")
    pipeline = folder / "log.toml"
    text = READING.replace("FORCE", "wrench.z").replace("HEIGHT", "tip.z")
    pipeline.write_text(f'[run]\nname = "log"\n[device.log]\ntype = "mcap-replay"\nfile = "log.mcap"\n{text}')
    damaged = folder / "damaged.mcap"
    commands: dict[str, Callable[[], object]] = {
        "run": lambda: watched("run", "run", pipeline, "--out", folder / "run"),
        "info": lambda: watched("info", "info", path),
        "parquet": lambda: watched("export .parquet", "export", path, "-o", folder / "x.parquet"),
        "csv": lambda: watched("export .csv", "export", path, "-o", folder / "x.csv"),
        "recover": lambda: recovered(path, damaged, folder),
    }
    each(commands, options)


def recovered(path: Path, damaged: Path, folder: Path) -> None:
    """`recover` of the log with a byte changed in its middle and its last tenth cut off."""
    path.rename(damaged)  # a copy would need as much again
    with damaged.open("r+b") as file:
        file.seek(damaged.stat().st_size // 2)
        byte = file.read(1)
        file.seek(-1, os.SEEK_CUR)
        file.write(bytes([byte[0] ^ 1]))
        file.truncate(damaged.stat().st_size * 9 // 10)
    watched("recover", "recover", damaged, "-o", folder / "whole.mcap")


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
            "parquet": lambda: watched("export .parquet", "export", path, "-o", folder / "x.parquet"),
        },
        options,
    )


def sweep(options: argparse.Namespace) -> None:
    """A second of contact with one filter, so many settings of its noise."""
    count, folder = int(options.settings), options.folder
    text = (PIPELINES / "point.toml").read_text().replace('duration = "10 s"', 'duration = "1 s"')
    text = text.partition("[estimator.kinematic]")[0]
    stds = ", ".join(f"{0.02 + 0.06 * i / count:.6f}" for i in range(count))
    pipeline = folder / "sweep.toml"
    pipeline.write_text(f'{text}\n[sweep]\n"estimator.ekf.force_std" = [{stds}]\n')
    out = folder / "sweep"
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
            "lumps": lambda: watched("lumps", "lumps", run),
            "report": lambda: watched("report", "report", run),
        },
        options,
    )


def day(options: argparse.Namespace) -> None:
    """Hours of a point palpation on the simulated rig."""
    folder = options.folder
    watched(
        f"run of {options.hours:g} h",
        *("run", PIPELINES / "point.toml", "--out", folder / "day"),
        *("--set", f"trajectory.press.duration={3600 * options.hours} s", "--set", "run.estimates_interval=1 s"),
    )
    size = sum(file.stat().st_size for file in (folder / "day").rglob("*") if file.is_file())
    print(f"the run folder holds {size / 2**30:.2f} GiB")


def each(commands: dict[str, Callable[[], object]], options: argparse.Namespace) -> None:
    """Those that are wanted, one after the other."""
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
