"""Processor time and lines of what reads a folder of fits of many curves: `repeat --by`, `repeat review`, `plot --by`.

    python benchmarks/thousands_of_curves.py [--animals 25] [--curves 40]

Two treatments of so many animals each, with so many curves of each: 2000 by default. Values are given and not fitted;
processes are real ones, with their start. At most 3 s of processor time and a screen are the goal of `repeat` and
`repeat review`.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.fit_tables import draw_animals

_PALPATE = (sys.executable, "-c", "from palpate_engine.cli import main; main()")
_COMMANDS = {
    "repeat --by treatment": ("repeat", "fits", "--by", "treatment"),
    "repeat --by animal --unit curve": ("repeat", "fits", "--by", "animal", "--unit", "curve"),
    "repeat review": ("repeat", "review", "fits"),
    "repeat --table all.csv": ("repeat", "fits", "--table", "all.csv"),
    "plot --by treatment": ("plot", "fits", "--by", "treatment"),
    "report --by treatment": ("report", "fits", "--by", "treatment"),
}


def main() -> None:
    """Print a row for each command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--animals", type=int, default=25)
    parser.add_argument("--curves", type=int, default=40)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        draw_animals(Path(folder) / "fits", animals=asked.animals, curves=asked.curves)
        for name, words in _COMMANDS.items():
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            done = subprocess.run((*_PALPATE, *words), cwd=folder, capture_output=True, text=True, check=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            print(f"{name}: {spent:.2f} s, {len(done.stdout.splitlines())} lines", flush=True)


if __name__ == "__main__":
    main()
