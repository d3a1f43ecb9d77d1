"""Which tests go with what has changed since the last full run: prints their folders and files, for `.ci/run`.

A family's are those of the folder in `tests` that mirrors it. Where more has changed than they test, it prints nothing,
and on standard error that a full run is due.
"""

import re
import subprocess
import sys
from functools import partial
from pathlib import Path

ROOT = Path(__file__).parent.parent
# Families whose tests are not in the folder of their name alone.
FOLDERS = {
    "commands": ("cli", "starting"),
    "fits": ("fits", "curves"),
    "live": ("live_page",),
    "simulation": ("simulation", "devices"),
}
# What is no family and has tests of its own.
OTHERS = {
    "docs/tutorials/": "tests/test_walks.py",
    "pipelines/": "tests/test_pipelines.py",
    "tests/third_party/": "tests/test_third_party.py",
}
# What all tests stand on: core and kit, the dependencies, what tests share.
BASE = re.compile(r"core/|pyproject\.toml$|tests/(?!test_)\w+\.py$")
MOST = 4  # families


class FullRunDueError(Exception):
    """The tests of single families do not show what the changes do."""


def changed_since(commit: str, root: Path) -> list[str]:
    """Files that differ from a commit; raises FullRunDueError where it is no ancestor, or git cannot tell."""
    run = partial(subprocess.run, cwd=root, check=True, capture_output=True, text=True)
    try:
        run(["git", "merge-base", "--is-ancestor", commit, "HEAD"])
        return run(["git", "diff", "--name-only", "--no-renames", "-z", commit]).stdout.split("\0")[:-1]
    except OSError:
        raise FullRunDueError("there is no git here") from None
    except subprocess.CalledProcessError:
        raise FullRunDueError(".ci/verified names no commit before this one") from None


def tests_of(changed: list[str]) -> list[str]:
    """Folders and files of tests, as pytest takes them; raises FullRunDueError where it is more than a few families."""
    if base := next(filter(BASE.match, changed), None):
        raise FullRunDueError(f"{base} has changed, on which everything stands")
    families = {parts[1] for name in changed if (parts := name.split("/"))[0] == "plugins" and len(parts) > 2}
    if len(families) > MOST:
        raise FullRunDueError(f"{len(families)} families have changed")
    tests = {f"tests/{folder}" for family in families for folder in FOLDERS.get(family, (family,))}
    tests |= {test for place, test in OTHERS.items() if any(name.startswith(place) for name in changed)}
    return sorted(tests | {"/".join(name.split("/")[:2]) for name in changed if name.startswith("tests/")})


def main() -> None:
    """Print them."""
    verified = ROOT / ".ci" / "verified"
    try:
        found = tests_of(changed_since(verified.read_text().strip() if verified.exists() else "", ROOT))
    except FullRunDueError as reason:
        print(f"A full run is due (.ci/full): {reason}.", file=sys.stderr)
        return
    print("\n".join(name for name in found if (ROOT / name).exists()))


if __name__ == "__main__":
    main()
