"""What becomes of damaged logs: what a run makes of them, and how much of the rest `palpate log recover` brings back.

    python benchmarks/damage.py outcomes [--count 8] [--seed 1]   logs of all kinds, damaged in seven ways, in a run
    python benchmarks/damage.py recover [--count 25] [--seed 1]   MCAP, damaged in eight ways, counted by `mcap`

`outcomes`: a press of 4 s in every kind of file. Each damaged one is read by a pipeline; samples and flags are held
against those of the whole file. `recover`: logs of 6000 messages, in five ways of writing; of each, the messages of all
chunks of which no byte was touched are counted in what was written, and looked for in what was recovered.
"""

import argparse
import gzip
import shutil
import signal
import struct
import sys
import tempfile
import time
import traceback
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import zstandard
from mcap.writer import Writer
from palpate import Samples, UserError
from palpate_devices.mcap_replay import McapReplay
from palpate_engine import Source, build_pipeline, run_pipeline
from palpate_kit.runs.sample_observer import SampleObserver

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.logs.damage import cut_out, cut_short, many_bits, no_ends, one_bit, overwritten, put_in

from tests.logs import damage
from tests.records.bags import press, write_bag


def recover(options: argparse.Namespace) -> None:
    """Print the table of kinds of damage and what came back."""
    logs = {style: damage.write(style) for style in damage.WRITERS}
    written = {style: list(damage.chunks(raw)) for style, raw in logs.items()}
    print(f"{'damage':15}{'logs':>6}{'whole':>10}{'back':>10}{'share %':>9}{'not true':>10}{'refused':>9}{'most s':>8}")
    totals, longest = np.zeros(4, int), 0.0
    with tempfile.TemporaryDirectory() as folder:
        for number, kind in enumerate(damage.KINDS):
            row, slowest = np.zeros(4, int), 0.0
            for i in range(options.count):
                rng = np.random.default_rng([options.seed, number, i])
                style = list(logs)[i % len(logs)]
                damaged = kind(logs[style], rng)
                began = time.perf_counter()
                row += _outcome(damaged, written[style], Path(folder), f"{kind.__name__}, {i}, {style}")
                slowest = max(slowest, time.perf_counter() - began)
            _print(kind.__name__, options.count, row, slowest)
            totals, longest = totals + row, max(longest, slowest)
    _print("all", options.count * len(damage.KINDS), totals, longest)


def _print(name: str, count: int, row: np.ndarray, slowest: float) -> None:
    share = 100.0 * row[1] / max(row[0], 1)
    print(f"{name:15}{count:6}{row[0]:10}{row[1]:10}{share:9.3f}{row[2]:10}{row[3]:9}{slowest:8.2f}")


def _outcome(damaged: damage.Damaged, written: list, folder: Path, name: str) -> np.ndarray:
    """Messages that are whole, that came back, that came back and were never written; refusals."""
    bad, good = folder / "bad.mcap", folder / "good.mcap"
    bad.write_bytes(damaged.raw)
    good.unlink(missing_ok=True)
    expected = damage.whole(damaged, written)
    everything = sum((messages for _, _, messages in written), start=type(expected)())
    try:
        said = McapReplay.recover(bad, good)
    except UserError as refusal:
        if expected:
            print(f"  {name}: {refusal}")
        return np.array([expected.total(), 0, 0, 1])
    found = damage.messages(good)
    back = (found & expected).total()
    if back < expected.total() or found - everything:
        print(f"  {name}: {back} of {expected.total()}: {said}")
    return np.array([expected.total(), back, (found - everything).total(), 0])


OUTCOMES = ("refused", "same", "flagged", "unseen", "traceback", "hang")
PATIENCE = 120  # [s] of the clock, on a busy machine, that make a hang
PIPELINE = """
[run]
name = "damaged"
[device.log]
type = "{type}"
file = "{file}"
{rest}
[alignment]
force = "log.{force}"
position = "log.{position}"
"""
MAPPED = """
[device.log.signals]
force = { topic = "/force", field = "data", unit = "N" }
z = { topic = "/height", field = "data", unit = "m" }
"""
TABLE = """
time = { column = "t", unit = "s" }
[device.log.columns]
z = { column = "z", unit = "m" }
force = { column = "force", unit = "N" }
"""
NUMBER, CDR = "std_msgs/msg/Float64", b"\0\1\0\0"
WAYS = (one_bit, many_bits, overwritten, cut_short, cut_out, put_in, no_ends)


@dataclass(frozen=True)
class Made:
    """A whole log, the file of it that is damaged, and a pipeline that reads it."""

    pipeline: Path
    damaged: Path


class Hung(BaseException):
    """Time is over."""


def outcomes(options: argparse.Namespace) -> None:
    """Print the table of kinds of logs and what a run made of those that were damaged."""
    print(f"{'kind':28}{'logs':>6}" + "".join(f"{name:>10}" for name in OUTCOMES) + f"{'most s':>9}", flush=True)
    totals, longest = Counter[str](), 0.0
    signal.signal(signal.SIGALRM, _hang)
    with tempfile.TemporaryDirectory() as root:
        for number, (name, made) in enumerate(kinds_of_logs(Path(root)).items()):
            if options.only and name not in options.only:
                continue
            row, slowest = Counter[str](), 0.0
            truth = _read(made)
            assert truth is not None, name
            raw = made.damaged.read_bytes()
            for way, kind in enumerate(WAYS):
                for i in range(options.count):
                    rng = np.random.default_rng([options.seed, number, way, i])
                    began = time.perf_counter()
                    row[_judged(made, kind(raw, rng).raw, truth, f"{name}, {kind.__name__}, {i}")] += 1
                    slowest = max(slowest, time.perf_counter() - began)
            made.damaged.write_bytes(raw)
            _row(name, row, slowest)
            totals, longest = totals + row, max(longest, slowest)
    _row("all", totals, longest)
    most = next(line.split()[1] for line in Path("/proc/self/status").read_text().splitlines() if "VmHWM" in line)
    print(f"memory of the process: {int(most) / 1024:.0f} MiB at most")


def _hang(*_: object) -> None:
    raise Hung


def _row(name: str, row: Counter[str], slowest: float) -> None:
    counts = "".join(f"{row[outcome]:10}" for outcome in OUTCOMES)
    print(f"{name:28}{row.total():6}{counts}{slowest:9.2f}", flush=True)


def kinds_of_logs(root: Path) -> dict[str, Made]:
    """A press of 4 s in every kind of file, each in a folder of its own."""
    times, height, _, force = press()
    found = {}

    def folder(name: str) -> Path:
        path = root / str(len(found)) / name
        path.parent.mkdir()
        return path

    for style in damage.WRITERS:
        path = folder("log.mcap")
        _mcap(path, style, times, height, force)
        found[f"MCAP, {style}"] = _made(path, "mcap-replay", MAPPED, "force.force", "height.z")
    path = folder("log.mcap")
    _mcap(path, "zstd", times, height, force)
    found["MCAP, accept_cut"] = _made(path, "mcap-replay", f"accept_cut = true{MAPPED}", "force.force", "height.z")
    text = "t,z,force\n" + "".join(f"{t:.3f},{z:.7f},{f:.4f}\n" for t, z, f in zip(times, height, force, strict=True))
    for name, pack in (("log.csv", bytes), ("log.csv.gz", gzip.compress)):
        path = folder(name)
        path.write_bytes(pack(text.encode()))
        found[name.partition(".")[2]] = _made(path, "csv-replay", TABLE, "force", "z")
    for name, pack in (("log.db3", bytes), ("log.db3.gz", gzip.compress), ("log.db3.zstd", _zstd)):
        path = folder(name)
        raw = _bag(path.with_name("whole.db3"), times, height, force).read_bytes()
        path.write_bytes(pack(raw))
        found[name.partition(".")[2]] = _made(path, "rosbag2-replay", MAPPED, "force.force", "height.z")
    path = folder("bag")
    path.mkdir()
    _bag(path / "bag_0.db3", times, height, force)
    (path / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n  relative_file_paths:\n"
        "    - bag_0.db3\n  compression_format: ''\n  compression_mode: ''\n"
    )
    made = _made(path, "rosbag2-replay", MAPPED, "force.force", "height.z")
    found["metadata.yaml"] = replace(made, damaged=path / "metadata.yaml")
    return found


def _made(path: Path, kind: str, rest: str, force: str, position: str) -> Made:
    text = PIPELINE.format(type=kind, file=path, rest=rest, force=force, position=position)
    pipeline = path.parent / "pipeline.toml"
    pipeline.write_text(text)
    return Made(pipeline, path)


def _messages(times: np.ndarray, height: np.ndarray, force: np.ndarray) -> dict[str, list[tuple[int, bytes]]]:
    stamps = (10**9 + np.rint(times * 1e9)).astype(np.int64).tolist()
    columns = {"/force": force.tolist(), "/height": height.tolist()}
    return {
        topic: [(stamp, CDR + struct.pack("<d", value)) for stamp, value in zip(stamps, values, strict=True)]
        for topic, values in columns.items()
    }


def _mcap(path: Path, style: str, *columns: np.ndarray) -> None:
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=8192, **damage.WRITERS[style])
        writer.start(profile="ros2", library="damage")
        schema = writer.register_schema(NUMBER, "ros2msg", b"float64 data")
        rows = []
        for topic, messages in _messages(*columns).items():
            channel = writer.register_channel(topic, "cdr", schema)
            rows += [(stamp, channel, message) for stamp, message in messages]
        for stamp, channel, message in sorted(rows):
            writer.add_message(channel, stamp, message, stamp)
        writer.finish()


def _bag(path: Path, *columns: np.ndarray) -> Path:
    return write_bag(path, [(topic, NUMBER, messages) for topic, messages in _messages(*columns).items()])


def _zstd(raw: bytes) -> bytes:
    return zstandard.ZstdCompressor().compress(raw)


Seen = tuple[np.ndarray, tuple[str, ...]]  # (n, 4) samples, and flags


def _judged(made: Made, raw: bytes, truth: Seen, name: str) -> str:
    """What a run makes of a damaged log."""
    made.damaged.write_bytes(raw)
    signal.alarm(PATIENCE)
    try:
        found = _read(made)
    except Hung:
        print(f"  {name}: hangs")
        return "hang"
    except Exception:
        print(f"  {name}:\n{traceback.format_exc()}")
        return "traceback"
    finally:
        signal.alarm(0)
    if found is None:
        return "refused"
    if found[0].shape == truth[0].shape and np.array_equal(found[0], truth[0], equal_nan=True):
        return "same"
    if set(found[1]) - set(truth[1]):
        return "flagged"
    return "unseen"


def _read(made: Made) -> Seen | None:
    """Samples and flags of a run; None where it refuses."""
    kept = SampleObserver()
    out = made.damaged.parent / "run"
    shutil.rmtree(out, ignore_errors=True)
    try:
        result = run_pipeline(build_pipeline(Source.read(made.pipeline), estimates=False), out, observer=kept)
    except UserError:
        return None
    codes = tuple(flag.code for flag in result.flags)
    if not kept.blocks:
        return np.zeros((0, 4)), codes
    samples = Samples.joined(kept.blocks)
    columns = np.column_stack([samples.stamp, samples.force, samples.position, samples.interval])
    return columns, codes


def main() -> None:
    """Parse and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    kinds = parser.add_subparsers(dest="kind", required=True)
    for function, count in ((outcomes, 8), (recover, 25)):
        kind = kinds.add_parser(function.__name__, help=function.__doc__)
        kind.add_argument("--count", type=int, default=count, help="logs of each kind and each damage")
        kind.add_argument("--seed", type=int, default=1)
        if function is outcomes:
            kind.add_argument("--only", action="append", metavar="KIND", help="only this kind of log")
        kind.set_defaults(function=function)
    options = parser.parse_args()
    options.function(options)


if __name__ == "__main__":
    main()
