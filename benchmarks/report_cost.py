"""CPU seconds that a report takes: ``python benchmarks/report_cost.py RUN [RUN...]``, all in one for several runs.

Each report is made in a process of its own, three times: user and system time of the whole process, the start of the
interpreter and the writing of the file included. CPU time depends little on what else the machine does.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path


def cost(runs: list[str], file: Path) -> float:
    """CPU [s] of one report of these runs; raises CalledProcessError if none was written."""
    before = os.times()
    words = [sys.executable, "-c", "from palpate_engine.cli import main; main()", "report", *runs, "--out", str(file)]
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def main() -> None:
    """The median and the largest of three, and the size of the file."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "report.html"
        found = []
        for _ in range(3):
            file.unlink(missing_ok=True)
            found.append(cost(sys.argv[1:], file))
        size = file.stat().st_size / 1e3
    cpu, runs = f"{statistics.median(found):.2f} s of CPU (largest {max(found):.2f})", len(sys.argv) - 1
    print(f"{cpu}, {size:.0f} kB, of {runs} runs")


if __name__ == "__main__":
    main()
