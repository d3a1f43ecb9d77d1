"""CPU seconds of the first commands that anybody calls, as a multiple of a bare Python; medians of interleaved runs.

Run it with: python benchmarks/first_second.py [ROUNDS]
"""

import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
PALPATE = [sys.executable, "-c", "from palpate_engine.cli import main; main()"]
POINT = [*PALPATE, "run", str(ROOT / "pipelines" / "point.toml")]
COMMANDS = {
    "python -c pass": [sys.executable, "-c", "pass"],
    "palpate --version": [*PALPATE, "--version"],
    "palpate --help": [*PALPATE, "--help"],
    "palpate check point.toml": [*PALPATE, "check", str(ROOT / "pipelines" / "point.toml")],
    "palpate run point.toml": POINT,
}


def cpu_seconds(command: list[str], kept: str) -> float:
    """User and system time of a process and its children, which find byte code and kernels where they left them."""
    surroundings = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    surroundings |= {"PYTHONPYCACHEPREFIX": f"{kept}/python", "PALPATE_CACHE": f"{kept}/palpate"}
    with tempfile.TemporaryDirectory() as folder:
        before = os.times()
        subprocess.run(
            command, cwd=folder, env=surroundings, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True
        )
        after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def main() -> None:
    """Print the table."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    taken: dict[str, list[float]] = {name: [] for name in COMMANDS}
    with tempfile.TemporaryDirectory() as kept:
        for command in COMMANDS.values():
            cpu_seconds(command, kept)
        for _ in range(rounds):
            for name, command in COMMANDS.items():
                taken[name].append(cpu_seconds(command, kept))
    bare = statistics.median(taken["python -c pass"])
    print(f"{'command':<28}{'CPU s':>8}{'x python':>10}")
    for name, seconds in taken.items():
        median = statistics.median(seconds)
        print(f"{name:<28}{median:8.3f}{median / bare:10.1f}")


if __name__ == "__main__":
    main()
