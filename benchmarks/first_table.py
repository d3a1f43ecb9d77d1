"""How long it takes from a fresh clone to a table of one's own files.

Run it with: python benchmarks/first_table.py [FILES]. The walk is that of the documents: a new environment, the
installation from this folder (packages from the index or its cache), and `palpate fit curves
--tip "paraboloid 3 mm"` on files in three dialects. It prints the time of each step by the clock, and the table.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
DIALECTS = (
    ("time_s,force_N,height_mm", ",", (0, 2, 1)),
    ("t [s];z [mm];F [N]", ";", (0, 1, 2)),
    ("F [N]\tt [s]\tz [mm]", "\t", (2, 0, 1)),
)


def write(folder, count):
    """Presses of 4 mm, each a file."""
    for i in range(count):
        random = np.random.default_rng(i)
        seconds = np.arange(700) / 500
        depth = 4e-3 * np.sin(np.pi * seconds / seconds[-1]) - 1e-3
        speed, contact = np.gradient(depth, seconds), np.maximum(depth, 0.0)
        elastic = 16 / 9 * 1e5 * (1 + 0.3 * np.sin(i)) * np.sqrt(3e-3) * contact**1.5
        force = np.maximum(elastic + 8 * 360 * np.sqrt(3e-3 * contact) * speed, 0.0) + 0.02 * random.standard_normal(
            700
        )
        columns = [seconds, -1e3 * depth + 2e-4 * random.standard_normal(700), force]
        head, delimiter, order = DIALECTS[i % len(DIALECTS)]
        table = np.column_stack([columns[place] for place in order])
        np.savetxt(folder / f"{i:02}.csv", table, delimiter=delimiter, header=head, comments="")


def main() -> None:
    """Walk, and print the times."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        (place / "curves").mkdir()
        write(place / "curves", count)
        scripts = place / "venv" / "bin"
        steps = {
            "a new environment": [sys.executable, "-m", "venv", str(place / "venv")],
            "the installation": [str(scripts / "pip"), "install", "-q", str(ROOT)],
            f"{count} files to a table": [str(scripts / "palpate"), "fit", "curves", "--tip", "paraboloid 3 mm"],
        }
        total = 0.0
        for step, command in steps.items():
            before = time.perf_counter()
            done = subprocess.run(command, cwd=place, text=True, capture_output=True, check=False)
            total += (taken := time.perf_counter() - before)
            print(f"{step:<24} {taken:6.1f} s", done.stderr.strip(), sep="\n" if done.stderr.strip() else "")
            if step.endswith("table"):
                print(done.stdout)
        print(f"{'in all':<24} {total:6.1f} s")


if __name__ == "__main__":
    main()
