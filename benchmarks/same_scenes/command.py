"""One command of palpate in a process of its own, as it would be typed."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PALPATE = [sys.executable, "-c", "import sys; sys.argv[0] = 'palpate'; from palpate_engine.cli import main; main()"]


def palpate(*arguments: object, cwd: Path = ROOT) -> str:
    """Run a command and return what it prints; raises CalledProcessError where it fails."""
    done = subprocess.run([*PALPATE, *map(str, arguments)], cwd=cwd, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.stderr.write(done.stderr)
    done.check_returncode()
    return done.stdout
