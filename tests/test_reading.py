"""How the code reads: what a package has of names without a subject and of docstrings that ask must not rise."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
import tomllib
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
CEILINGS = ROOT / "tests" / "reading.toml"
FOLDERS = ("core", "plugins", "distributions")
# Locals and parameters that do not say what they hold.
GENERIC = frozenset(
    [
        *("about", "at", "by", "each", "every", "found", "given", "here", "kind", "known", "least", "left", "looked"),
        *("made", "most", "of", "one", "others", "own", "rest", "said", "seen", "taken", "there", "told", "wanted"),
        *("what", "word", "words"),
    ]
)
OPENING = re.compile(r"(What|Whether|How|Where|Which|Who|Why|By how|By what|Those|That|Whatever)\b")
KINDS = ("generic_names", "openings", "moods")


def package_of(path: Path) -> str:
    """Return the two folders that a file's counts belong to, such as ``plugins/fits``."""
    return "/".join(path.relative_to(ROOT).parts[:2])


def sources() -> list[Path]:
    """Return the files of the product, without its tests."""
    files = (path for folder in FOLDERS for path in (ROOT / folder).glob("*/**/*.py"))
    return sorted(path for path in files if not {"tests", ".venv", "build"} & set(path.relative_to(ROOT).parts))


def generic_names(tree: ast.AST) -> int:
    """Return how often a local or a parameter of a file has a name without a subject."""
    stored = (node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store))
    parameters = (node.arg for node in ast.walk(tree) if isinstance(node, ast.arg))
    return sum(name in GENERIC for name in (*stored, *parameters))


def openings(tree: ast.AST) -> int:
    """Return how many docstrings of a file begin as a question or a relative clause does."""
    documented = ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef
    texts = (ast.get_docstring(node) for node in ast.walk(tree) if isinstance(node, documented))
    return sum(bool(text and OPENING.match(text)) for text in texts)


@cache
def counts() -> dict[str, Counter[str]]:
    """Return the counts of every package, by kind."""
    by_package: dict[str, Counter[str]] = {}
    for path in sources():
        tree = ast.parse(path.read_text())
        package = by_package.setdefault(package_of(path), Counter())
        package["generic_names"] += generic_names(tree)
        package["openings"] += openings(tree)
    command = [sys.executable, "-m", "ruff", "check", "--select", "D401", "--output-format", "json", *FOLDERS]
    report = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    known = {str(path) for path in sources()}
    for finding in json.loads(report.stdout):
        if finding["filename"] in known:
            by_package[package_of(Path(finding["filename"]))]["moods"] += 1
    return by_package


@cache
def ceilings() -> dict[str, dict[str, int]]:
    """Return the highest permitted count of every package, by kind."""
    return tomllib.loads(CEILINGS.read_text())


def test_each_package_has_its_ceilings() -> None:
    assert counts().keys() == ceilings().keys()


@pytest.mark.parametrize("package", sorted(ceilings()))
def test_no_count_rises(package: str) -> None:
    rises = {kind: counts()[package][kind] - ceilings()[package].get(kind, 0) for kind in KINDS}
    rises = {kind: rise for kind, rise in rises.items() if rise > 0}
    assert not rises, f"{package}: {rises} more than in {CEILINGS.name}; CONTRIBUTING says how code reads here"


def test_what_is_counted() -> None:
    asking = ast.parse('def judge(found):\n    """Whether it is."""\n    left = found\n    return left')
    assert (generic_names(asking), openings(asking)) == (2, 1)
    assert not generic_names(ast.parse("def judge(residual): onset = residual"))


if __name__ == "__main__":  # writes the ceilings of today
    CEILINGS.write_text(
        "# The most that a package has of each kind: see test_reading.py, which writes this file.\n"
        + "".join(
            f'["{package}"]\n' + "".join(f"{kind} = {count[kind]}\n" for kind in KINDS) + "\n"
            for package, count in sorted(counts().items())
        )
    )
