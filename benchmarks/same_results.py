"""Whether palpate gives the same numbers and words as before a change, to the bit.

Run it with: python benchmarks/same_results.py FOLDER            before the change
             python benchmarks/same_results.py FOLDER2 FOLDER    after it; prints what differs, and ends with 1
With --part runs or --part study it makes and compares one of its two parts; without, both run side by side.

`same_scenes.runs`: every shipped pipeline on the simulated rig; replays of one of their logs, as MCAP and as CSV; a
rehearsal of a robot's pipeline, which is the live path in simulated time, and its replay; fits of logs, alone, all by
`fit --each`, and of a press by `indentation`; a filter as C by `export-filter`.

`same_scenes.study`: folders of curves by `fit --tip`, `curves.csv`, `rig.toml`, `--each` and `--by`; folders of
fits fitted again with other settings and new files; `repeat`, `pack` and `verify`; laws of a `material`; a calibration
from a record; curves on the page of the desk and in Python.
"""

import argparse
import hashlib
import json
import re
import sys
import zipfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from same_scenes.runs import run_pipelines
from same_scenes.study import run_study

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
    "created",
    "duration",
    *("file", "folder", "sha256", "source"),  # of logs, which hold the time of their run
}
HASHED = {".csv", ".c", ".h"}
INSTANT = re.compile(rb"20\d\d-\d\d-\d\dT[\d:.]+(Z|[+-]\d\d:\d\d)?")  # at which a run or a change was made


def numbers(folder: Path) -> dict[str, str]:
    """Return every number and text of all results by its place, and hashes of tables, programs and streams."""
    found = {}
    for path in sorted(folder.glob("*/**/*")):
        name = str(path.relative_to(folder))
        is_of_study = name.startswith("study/")
        if path.suffix == ".json":
            found |= {f"{name}: {key}": value for key, value in leaves(json.loads(path.read_text()))}
        elif path.suffix in HASHED:
            found[name] = digest(INSTANT.sub(b"", path.read_bytes()))
        elif path.suffix == ".toml" and is_of_study:
            text = path.read_text().replace(str(folder.resolve()), "")
            found |= {
                f"{name}:{number}": line
                for number, line in enumerate(text.splitlines(), start=1)
                if "created" not in line
            }
        elif path.suffix == ".zip":
            with zipfile.ZipFile(path) as archive:
                found |= {f"{name}: {member}": digest(archive.read(member)) for member in archive.namelist()}
    return found


def digest(content: bytes) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(content).hexdigest()


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
    options = argparse.ArgumentParser()
    options.add_argument("folder", type=Path)
    options.add_argument("before", type=Path, nargs="?")
    options.add_argument("--part", choices=("runs", "study"))
    asked = options.parse_args()
    parts = {"runs": partial(run_pipelines, asked.folder), "study": partial(run_study, asked.folder / "study")}
    with ThreadPoolExecutor(2) as pool:
        for done in [pool.submit(run) for name, run in parts.items() if asked.part in (None, name)]:
            done.result()
    now = numbers(asked.folder)
    (asked.folder / "numbers.json").write_text(json.dumps(now, indent=0))
    if asked.before is not None:
        old = json.loads((asked.before / "numbers.json").read_text())
        old = {key: text for key, text in old.items() if is_of(asked.part, key)}
        differing = sorted(key for key in now.keys() | old.keys() if now.get(key) != old.get(key))
        for key in differing:
            print(f"{key} is {now.get(key, 'missing')}, was {old.get(key, 'missing')}")
        print(f"{len(now)} numbers, texts and hashes, {len(differing)} differ")
        sys.exit(bool(differing))


def is_of(part: str | None, key: str) -> bool:
    """Return True if the place of a number is in a part, or all parts are asked for."""
    return part is None or key.startswith("study/") == (part == "study")


if __name__ == "__main__":
    main()
