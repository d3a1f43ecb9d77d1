"""A distribution of one's own: a part or an analysis with its test, from texts that are tested as they are."""

from __future__ import annotations

from importlib.resources import files
from string import Template

from palpate import API

# By kind: module of the part or command, its class, hook, class that it derives from, and name.
_OFFERS = {
    "tip": ("funnel", "Funnel", "palpate_indenters", "Indenter", "funnel"),
    "model": ("foam", "Foam", "palpate_models", "ContactModel", "foam"),
    "filter": ("known_surface", "KnownSurface", "palpate_estimators", "Estimator", "known-surface"),
    "device": ("pendulum", "Pendulum", "palpate_devices", "Device", "pendulum"),
    "arm": ("arm", "Arm", "palpate_devices", "Device", "NAME"),
    "trajectory": ("dip", "Dip", "palpate_trajectories", "Trajectory", "dip"),
    "analysis": ("histogram", "", "palpate_commands", "", ""),
}
KINDS = tuple(_OFFERS)
# The files of a kind besides its module and its test, by path in the distribution.
_EXTRA_FILES = {
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


def distribution(kind: str, name: str) -> dict[str, str]:
    """Return the texts of the files of a distribution of a kind, by their path in its folder.

    They are templates in which package, name and class of the new distribution are filled in.
    """
    package, short = name.replace("-", "_"), name.removeprefix("palpate-")
    module, class_, hook, root, part = _OFFERS[kind]
    placeholders = {
        "name": name,
        "package": package,
        "kind": kind,
        "hint": _HINTS.get(kind, ""),
        "title": f"{'An' if kind[0] in 'aeiou' else 'A'} {kind}",
        "module": module,
        "class_": class_,
        "hook": hook,
        "root": root,
        "part": part.replace("NAME", short),
        "api": API,
    }
    shared = {
        "pyproject.toml": "pyproject.txt",
        "README.md": "arm_readme.txt" if kind == "arm" else "readme.txt",
        f"{package}/__init__.py": "analysis_hook.txt" if kind == "analysis" else "part_hook.txt",
    }
    texts = {path: Template(_text(source)).substitute(placeholders) for path, source in shared.items()}
    texts[f"{package}/py.typed"] = ""
    kind_files = {f"{package}/{module}.py": f"{kind}.txt", f"tests/test_{package}.py": f"{kind}_test.txt"}
    kind_files |= {path.format(package=package): source for path, source in _EXTRA_FILES.get(kind, {}).items()}
    for path, source in kind_files.items():
        texts[path] = _text(source).replace("PACKAGE", package).replace("NAME", short).replace("CLASS", short)
    return texts


def _text(name: str) -> str:
    return files(__name__).joinpath(name).read_text(encoding="utf-8")
