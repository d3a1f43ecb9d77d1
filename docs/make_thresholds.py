"""The page of thresholds, from the constants of the code that judges; `make_reference` writes it."""

import ast
import re
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

PACKAGES = ("palpate_uncertainty", "palpate_engine.result", "palpate.evidence")
_HEAD = """# Thresholds

Here you can look up each number that decides a verdict or enters an uncertainty: its value, and what it decides.
The page is made from the constants of `palpate_uncertainty`, `palpate_engine.result` and `palpate.evidence`. A number
without another origin is a choice, whose rates of error stand in [decisions](../decisions/README.md). What an
alternative of a fact is, such as a delay of 10 ms, stands here as well; what is stated of a rig does not: see
[facts](../rig-facts.md).
"""
# Words of a comment by which a number has another origin than a choice.
_LAW = (
    r"\b(19|20)\d\d\b|\blaw of\b|\bequation\b|\beq\. \d|\bnormal noise\b|\brectangular distribution\b"
    r"|\bof white noise of variance 1\b|\brandom walk\b"
)
_MEASUREMENT = r"(?<!not )\bby chance\b|\bof \d+ (tracks|values|records)\b|\boccurs\b|\bthe most of\b"


class Threshold(NamedTuple):
    """A constant of a module, with its comment."""

    module: str
    constants: tuple[str, ...]
    value: str
    comment: str

    @property
    def name(self) -> str:
        """The words of the constants' names."""
        return ", ".join(constant.replace("_", " ").strip().lower() for constant in self.constants)

    @property
    def unit(self) -> str:
        """The unit in brackets at the begin of the comment; empty where the number is a share or a count."""
        match = re.match(r"(\[[^\]]+\](?:, \[[^\]]+\])*)", self.comment)
        return match[1].replace("[", "").replace("]", "") if match else ""

    @property
    def meaning(self) -> str:
        """What the number is of, without unit and origin."""
        text = re.sub(r"^(\[[^\]]+\],? ?)+", "", self.comment)
        return re.sub(r"[;,:]? ?\(?\ba choice\b(?: of \w+)?\)?|; the same$", "", text).strip(" ,;:")

    @property
    def origin(self) -> str:
        """A law, a measurement or a choice; with the decision that the comment names."""
        decision = re.search(r"\(?decision (\d{4})\)?", self.comment)
        kind = "choice"
        if re.search(_LAW, self.comment):
            kind = "law"
        elif re.search(_MEASUREMENT, self.comment):
            kind = "measurement"
        return f"{kind}, {decision[1]}" if decision else kind


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
        names = ast.unparse(node.targets[0]).strip("()")
        if re.fullmatch(r"[_A-Z0-9, ]+", names):
            comment = lines[node.end_lineno - 1].partition("#")[2].strip()
            yield Threshold(path.stem, tuple(names.split(", ")), ast.unparse(node.value), comment)


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
            "| module | threshold | value | unit | of | origin |",
            "|---|---|---|---|---|---|",
        ]
        for row in thresholds(package):
            meaning = row.meaning.replace("|", "/")
            lines.append(f"| `{row.module}` | {row.name} | `{row.value}` | {row.unit} | {meaning} | {row.origin} |")
        lines.append("")
    return "\n".join(lines)
