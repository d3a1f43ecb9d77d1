"""Whether all shipped pipelines give the same numbers as before a change, to the bit.

Run it with: python benchmarks/same_results.py FOLDER            before the change
             python benchmarks/same_results.py FOLDER2 FOLDER    after it; prints what differs, and ends with 1
"""

import hashlib
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
PALPATE = [sys.executable, "-c", "from palpate.cli import main; main()"]
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
}


def made(folder: Path) -> dict[str, str]:
    """Runs every pipeline; each number of its results by its place, and the hashes of its tables of estimates."""
    found = {}
    for path in SHIPPED:
        out = folder / path.relative_to(ROOT).with_suffix("")
        subprocess.run([*PALPATE, "run", path, "--out", out], cwd=ROOT, stdout=subprocess.DEVNULL, check=True)
        found |= {f"{out.name}: {key}": value for key, value in leaves(json.loads((out / "result.json").read_text()))}
        for table in sorted(out.glob("estimates*.csv")):
            found[f"{out.name}: {table.name}"] = hashlib.sha256(table.read_bytes()).hexdigest()
    return found


def leaves(value: Any, above: str = "") -> Iterator[tuple[str, str]]:
    """Every number and text of a document by its place."""
    if not isinstance(value, dict | list):
        yield above, repr(value)
        return
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
        if key not in OF_ONE_RUN:
            yield from leaves(inner, f"{above}.{key}")


def main() -> None:
    """Run, keep, and compare."""
    folder, *before = (Path(name) for name in sys.argv[1:])
    now = made(folder)
    (folder / "numbers.json").write_text(json.dumps(now, indent=0))
    if before:
        old = json.loads((before[0] / "numbers.json").read_text())
        differing = sorted(key for key in now.keys() | old.keys() if now.get(key) != old.get(key))
        for key in differing:
            print(f"{key} is {now.get(key, 'missing')}, was {old.get(key, 'missing')}")
        print(f"{len(SHIPPED)} pipelines, {len(now)} numbers and texts, {len(differing)} differ")
        sys.exit(bool(differing))


if __name__ == "__main__":
    main()
