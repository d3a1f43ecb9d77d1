"""A distribution of one's own: a part or an analysis with its test, from texts that are tested as they are."""

from __future__ import annotations

from importlib.resources import files
from string import Template

from palpate import API

KINDS = ("tip", "model", "filter", "device", "arm", "trajectory", "analysis")
# What a kind has besides its module and its test, by its path in the distribution.
_MORE = {
    "arm": {
        "{package}/driver.py": "arm_driver.txt",
        "{package}/software_arm.py": "arm_software.txt",
        "point.toml": "arm_pipeline.txt",
    }
}
_HINTS = {
    "device": " A reader of logs is a device as well: as a `palpate_records.recording.Recording` it gives "
    "`palpate info LOG`, `palpate fit LOG`, `palpate fit FOLDER` and `palpate log export` at once."
}
_INTERFACE = "\n\nPALPATE_API = {}  # number of the interface for which it is written\n"
_SHARED = {"pyproject.toml": "pyproject.txt", "README.md": "readme.txt"}


def distribution(kind: str, name: str) -> dict[str, str]:
    """Files of a distribution by their path in its folder."""
    package = name.replace("-", "_")
    words = {"name": name, "package": package, "kind": kind, "hint": _HINTS.get(kind, "")}
    shared = _SHARED | ({"README.md": "arm_readme.txt"} if kind == "arm" else {})
    found = {path: Template(_text(source)).substitute(words) for path, source in shared.items()}
    own = {"{package}/__init__.py": f"{kind}.txt", "tests/test_{package}.py": f"{kind}_test.txt", **_MORE.get(kind, {})}
    found[f"{package}/py.typed"] = ""
    short = name.removeprefix("palpate-")
    for path, source in own.items():
        text = _text(source).replace("PACKAGE", package).replace("NAME", short).replace("CLASS", short)
        stated = _INTERFACE.format(API) if path.endswith("__init__.py") else ""
        found[path.format(package=package)] = text + stated
    return found


def _text(name: str) -> str:
    return files(__name__).joinpath(name).read_text(encoding="utf-8")
