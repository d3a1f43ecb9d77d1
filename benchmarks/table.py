"""The table of docs/benchmarks.md, each row with its ratio to a peer or limit.

Run it with: python benchmarks/table.py [--memory]
"""

import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
SPEED = [
    ["first_second.py"],
    ["filters_speed.py", "online"],
    ["logs.py"],
    ["simulations.py"],
    ["fits.py"],
    ["many_curves.py"],
]
MEMORY = [["logs_memory.py", "--gigabytes", "4"], ["fits.py", "--large"], ["filters_speed.py", "memory"]]


def main() -> None:
    """Run one benchmark after the other; ends with 1 where one of them fails."""
    failed = []
    for name, *arguments in [*SPEED, *(MEMORY if "--memory" in sys.argv else [])]:
        print(f"== {name} {' '.join(arguments)}", flush=True)
        if subprocess.run([sys.executable, HERE / name, *arguments]).returncode:
            failed.append(name)
    sys.exit(f"failed: {', '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
