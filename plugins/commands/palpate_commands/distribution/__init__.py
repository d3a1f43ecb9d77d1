"""A distribution of one's own: a part or an analysis with its test, from texts that are tested as they are."""

from __future__ import annotations

from importlib.resources import files
from string import Template

KINDS = ("tip", "model", "filter", "device", "trajectory", "analysis")
_SHARED = {"pyproject.toml": "pyproject.txt", "README.md": "readme.txt"}


def distribution(kind: str, name: str) -> dict[str, str]:
    """Files of a distribution by their path in its folder."""
    package = name.replace("-", "_")
    words = {"name": name, "package": package, "kind": kind}
    found = {path: Template(_text(source)).substitute(words) for path, source in _SHARED.items()}
    module, test = (_text(f"{kind}{ending}.txt").replace("PACKAGE", package) for ending in ("", "_test"))
    return found | {f"{package}/__init__.py": module, f"tests/test_{package}.py": test}


def _text(name: str) -> str:
    return files(__name__).joinpath(name).read_text(encoding="utf-8")
