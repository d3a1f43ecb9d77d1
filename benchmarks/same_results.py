"""Whether palpate gives the same numbers as before a change, to the bit.

Run it with: python benchmarks/same_results.py FOLDER            before the change
             python benchmarks/same_results.py FOLDER2 FOLDER    after it; prints what differs, and ends with 1

What is run: every shipped pipeline on the simulated rig; replays of one of their logs, as MCAP and as CSV; a rehearsal
of a robot's pipeline, which is the live path in simulated time, and its replay; fits of logs, alone, all by
`fit --each`, and of a press by `indentation`; a filter as C by `export-filter`.
"""

import hashlib
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
PALPATE = [sys.executable, "-c", "from palpate_engine.cli import main; main()"]
SHIPPED = sorted(path for path in ROOT.glob("pipelines/**/*.toml") if 'type = "sim"' in path.read_text())
# Of where, when, how fast and by which versions a run was made.
OF_ONE_RUN = {
    "seconds_per_sample",
    "pipeline",
    "palpate",
    "command",
    "versions",
    "plugins",
    "host",
    "started",
    "duration",
    *("file", "folder", "sha256", "source"),  # of logs, which hold the time of their run
}


def palpate(*arguments: object) -> None:
    """One command; raises CalledProcessError where it fails."""
    subprocess.run([*PALPATE, *map(str, arguments)], cwd=ROOT, stdout=subprocess.DEVNULL, check=True)


def run_all(folder: Path) -> None:
    """Every run, replay, fit and export, each into a folder of its own."""
    for path in SHIPPED:
        palpate("run", path, "--out", folder / path.stem)
    point = folder / "point"
    palpate("rehearse", "pipelines/point_ur3e.toml", "--hold-up", "robot 8 ms every 1 s", "--out", folder / "rehearsal")
    for run in ("point", "raster", "rehearsal"):
        palpate("replay", folder / run, "--add-estimator", "afukf", "--out", folder / f"replay_{run}")
    logs = folder / "logs"
    logs.mkdir()
    palpate("log", "export", point / "log.mcap", "--out", logs / "point.csv")
    palpate("run", "pipelines/filters.toml", "--set", "run.seed=2", "--out", folder / "second")
    palpate("log", "export", folder / "second" / "log.mcap", "--out", logs / "second.csv")
    signals = ("--force", "/rig/wrench:wrench.force.z", "--position", "/rig/tip:pose.position.z")
    pipeline = folder / "csv.toml"
    palpate("info", logs / "point.csv", *signals, "--velocity", "/rig/twist:twist.linear.z", "--out", pipeline)
    palpate("run", pipeline, "--out", folder / "replay_csv")
    palpate("fit", "--each", logs, "--pipeline", pipeline, "--out", folder / "each")
    palpate("fit", point, "--out", folder / "fit")
    palpate("fit", "indentation", point, "--out", folder / "indentation")
    palpate("model", "export", point, "--track", "dr/kinematic", "--out", folder / "controller")


def numbers(folder: Path) -> dict[str, str]:
    """Every number and text of all results by its place, and the hashes of tables, programs and recorded streams."""
    found = {}
    for path in sorted(folder.glob("*/**/*")):
        name = str(path.relative_to(folder))
        if path.suffix == ".json":
            found |= {f"{name}: {key}": value for key, value in leaves(json.loads(path.read_text()))}
        elif path.suffix in {".csv", ".c", ".h"}:
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def leaves(value: Any, above: str = "") -> Iterator[tuple[str, str]]:
    """Every number and text of a document by its place."""
    if not isinstance(value, dict | list):
        yield above, repr(value)
        return
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
        if str(key).rpartition(".")[2] not in OF_ONE_RUN:  # of inputs as well: rig.file
            yield from leaves(inner, f"{above}.{key}")


def main() -> None:
    """Run, keep, and compare."""
    folder, *before = (Path(name) for name in sys.argv[1:])
    run_all(folder)
    now = numbers(folder)
    (folder / "numbers.json").write_text(json.dumps(now, indent=0))
    if before:
        old = json.loads((before[0] / "numbers.json").read_text())
        differing = sorted(key for key in now.keys() | old.keys() if now.get(key) != old.get(key))
        for key in differing:
            print(f"{key} is {now.get(key, 'missing')}, was {old.get(key, 'missing')}")
        print(f"{len(now)} numbers, texts and hashes, {len(differing)} differ")
        sys.exit(bool(differing))


if __name__ == "__main__":
    main()
