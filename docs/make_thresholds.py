"""The page of thresholds, from the constants of the code that judges; `make_reference` writes it."""

import ast
import re
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

PACKAGES = ("palpate_uncertainty", "palpate_engine.result")
_HEAD = """# Thresholds

Here you can look up each number that decides a verdict or enters an uncertainty: its value, and what it decides.
The page is made from the constants of `palpate_uncertainty` and `palpate_engine.result`. A number comes from a law or a
measurement, which its line or a [decision](../decisions/README.md) names, or is a choice. What an alternative of a fact
is, such as a delay of 10 ms, stands here as well; what is stated of a rig does not: see [facts](../rig-facts.md).
"""


class Threshold(NamedTuple):
    """A constant of a module."""

    module: str
    name: str
    value: str
    meaning: str


def thresholds(package: str) -> Iterator[Threshold]:
    """Yield the numeric constants of a package's modules, with the comment behind each."""
    spec = find_spec(package)
    assert spec is not None
    for folder in spec.submodule_search_locations or ():
        for path in sorted(Path(folder).rglob("*.py")):
            yield from _of_module(path)


def _of_module(path: Path) -> Iterator[Threshold]:
    lines = path.read_text(encoding="utf-8").split("\n")
    for node in ast.parse("\n".join(lines)).body:
        if not isinstance(node, ast.Assign) or node.end_lineno is None or not _is_number(node.value):
            continue
        name = ast.unparse(node.targets[0]).strip("()")
        if re.fullmatch(r"[_A-Z0-9, ]+", name):
            meaning = lines[node.end_lineno - 1].partition("#")[2].strip()
            yield Threshold(path.stem, name.replace("_", " ").strip().lower(), ast.unparse(node.value), meaning)


def _is_number(value: ast.expr) -> bool:
    """Return True for a number, several of them, or an expression of numbers."""
    if isinstance(value, ast.Call) and isinstance(value.func, ast.Name):  # an object
        return False
    return any(isinstance(node, ast.Constant) and type(node.value) in (int, float) for node in ast.walk(value))


def page() -> str:
    """Return the page, with every threshold by package and module."""
    lines = [_HEAD]
    for package in PACKAGES:
        lines += [
            f"## {package}",
            "",
            "| module | threshold | value | what it decides | origin |",
            "|---|---|---|---|---|",
        ]
        for one in thresholds(package):
            meaning = one.meaning.replace("|", "/")
            lines.append(f"| `{one.module}` | {one.name} | `{one.value}` | {meaning} |")
        lines.append("")
    return "\n".join(lines)
