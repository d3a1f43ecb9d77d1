"""The table of results/speed-and-memory.md: each row with its command, and its ratio to a peer or a limit.

Run it on a quiet machine; some four minutes. The rows go to the standard output as Markdown, to be pasted; what the
benchmarks print goes to the standard error. A row whose figure a benchmark does not print fails the command.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent


@dataclass(frozen=True)
class Row:
    """A figure of a benchmark: where it stands in what the benchmark prints, and what it is compared with."""

    work: str
    line: str  # pattern of a line, with the groups `figure` and, where there is one, `ratio`
    unit: str
    peer: str = ""


SPEED = {
    "first_second.py 3": (
        Row("`palpate --help`", r"palpate --help +(?P<figure>\S+) +(?P<ratio>\S+)", "s", "`python -c pass`"),
        Row(
            "`palpate run point.toml`",
            r"palpate run point.toml +(?P<figure>\S+) +(?P<ratio>\S+)",
            "s",
            "`python -c pass`",
        ),
    ),
    "logs.py --rounds 2": (
        Row(
            "log of 10 minutes into columns",
            r"columnar, zstd +(?P<figure>\S+) +\S+ +(?P<ratio>\S+)",
            "s",
            "as fast as `mcap` and `struct`",
        ),
        Row(
            "replay of it, EKF and AFUKF, a row every 10 ms, by the clock",
            r"llvm +every 10 ms +\S+ +\S+ +\S+ +\S+ +(?P<figure>\S+) +(?P<ratio>\S+)",
            "s",
            "real time",
        ),
    ),
    "simulations.py 2": (
        Row(
            "simulated raster of 154 s, by the clock",
            r"palpate run, by the clock +(?P<figure>\S+) s +(?P<ratio>\S+) x real",
            "s",
            "real time",
        ),
    ),
    "fits.py": (
        Row(
            "fit of 20 000 samples, samples to report",
            r"samples to report +(?P<figure>\S+) ms +(?P<ratio>\S+) x curve",
            "ms",
            "`curve_fit` by hand, one thread",
        ),
        Row(
            "atomic-force curve, to minimum",
            r"casadi-fit, samples to minimum +(?P<figure>\S+) ms +(?P<ratio>\S+) x",
            "ms",
            "nanite through lmfit",
        ),
        Row(
            "the same, to the report",
            r"casadi-fit, samples to report +(?P<figure>\S+) ms +(?P<ratio>\S+) x",
            "ms",
            "nanite through lmfit",
        ),
    ),
    "many_curves.py 100": (
        Row(
            "a curve of 1000 samples, looked at",
            r"look at +(?P<figure>\S+) ms +(?P<ratio>\S+) x",
            "ms",
            "`loadtxt` and `curve_fit`",
        ),
        Row(
            "the same, fitted by `fit --each`",
            r"fit --each +(?P<figure>\S+) ms +(?P<ratio>\S+) x",
            "ms",
            "`loadtxt` and `curve_fit`",
        ),
    ),
}
PEERS = (
    "pandas, curve_fit",
    "lmfit",
    "lmfit with intervals",
    "nanite",
    "nanite with its rating",
    "palpate, look and row",
)
SPEED["peers.py 20"] = tuple(
    Row(
        f"a curve of 1000 samples from its file to values, {peer}",
        rf"  {peer} +(?P<figure>\d\S*) ms +(?P<ratio>\S+) x by hand",
        "ms",
        "`loadtxt` and `curve_fit`",
    )
    for peer in PEERS
)
MEMORY = {
    "logs_memory.py --gigabytes 4": (Row("memory of reading a log of 4 GB", r"(?P<figure>\d+) MiB", "MiB"),),
    "fits.py --large": (Row("fit of 10^7 samples, whole process", r"whole process: (?P<figure>\S+) GB", "GB"),),
}


def printed(command: str) -> str:
    """What a benchmark prints; "" where it fails."""
    done = subprocess.run([sys.executable, HERE / command.split()[0], *command.split()[1:]], stdout=subprocess.PIPE)
    text = done.stdout.decode()
    print(text, file=sys.stderr, flush=True)
    return "" if done.returncode else text


def row_of(row: Row, command: str, text: str) -> str | None:
    """A row of the table; None where the benchmark has not printed its figure."""
    found = re.search(row.line, text)
    if found is None:
        return None
    ratio = found.groupdict().get("ratio")
    compared = f"{float(ratio):g} x {row.peer}" if ratio else ""
    return f"| {row.work} | {found['figure']} {row.unit} | {compared} | `benchmarks/{command}` |"


def main() -> None:
    """Run one benchmark after the other, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--memory", action="store_true", help="also what needs gigabytes and minutes")
    given = parser.parse_args()
    missing = []
    print(f"Load before: {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores.\n")
    print("| work | figure | ratio in that run | command |\n|---|---|---|---|", flush=True)
    for command, rows in (SPEED | MEMORY if given.memory else SPEED).items():
        text = printed(command)
        for row in rows:
            line = row_of(row, command, text)
            missing += [row.work] if line is None else []
            print(line or f"| {row.work} | **not printed** | | `benchmarks/{command}` |", flush=True)
    sys.exit(f"no figure for: {', '.join(missing)}" if missing else 0)


if __name__ == "__main__":
    main()
