"""The core knows no plugin by name, and works without any one family of analyses."""

import ast
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from palpate.registry import load

ROOT = Path(__file__).parents[2]
FAMILIES = sorted(f"palpate_{path.parent.name}" for path in ROOT.glob("plugins/*/README.md"))
PYPROJECT = ROOT / "pyproject.toml"
LIBRARIES = {"filterpy", "csv", "mcap", "point", "live"}  # words that are libraries, formats or plain English, too


def test_pyproject_names_every_package_that_there_is():
    text = PYPROJECT.read_text()
    page = runpy.run_path(str(ROOT / "plugins" / "make_pyproject.py"))["page"]
    assert page(text) == text
    assert page(text.replace('logs = "palpate_logs"\n', "").replace('"palpate_maps",', "")) == text


def strings(path):
    """Texts of a module but for its docstrings."""
    tree = ast.parse(path.read_text())
    documents = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    return [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documents
    ]


def test_no_word_of_the_core_names_a_plugin(root):
    names = {name for entries in load().parts.values() for name in entries} - LIBRARIES
    quoted = re.compile("|".join(rf'(?:^|["\'`]){re.escape(name)}(?:$|["\'`])' for name in sorted(names)))
    found = [
        f"{path.relative_to(root)}: {text!r}"
        for package in ("palpate", "palpate_engine")
        for path in sorted((root / "core" / package).rglob("*.py"))
        for text in strings(path)
        if quoted.search(text)
    ]
    assert not found


# Every command of all others answers; then a pipeline that needs several families is run.
WITHOUT = """
import contextlib, io, sys

gone, pipeline, out = sys.argv[1:]


class Gone:
    def find_spec(self, name, path=None, target=None):
        if f"{name}.".startswith(f"{gone}."):
            raise ModuleNotFoundError(name)


sys.meta_path.insert(0, Gone())
from palpate_engine.cli import call, main
from palpate_engine import registry

for name in registry.load().commands:
    with contextlib.redirect_stdout(io.StringIO()) as text:
        code = call([*name.split(), "--help"])
    if code or "Usage" not in text.getvalue():
        print(f"{name} --help ended with {code}")
main(["run", pipeline, "--out", out, "--set", "trajectory.press.duration=1 s"])
"""
# What a run of pipelines/filters.toml says where a family is away: by name, the part that is missing.
NEEDED = {
    "palpate_commands": "'run'",
    "palpate_devices": "mcap",
    "palpate_filters": "ekf",
    "palpate_models": "sphere",
    "palpate_simulation": "sim",
    "palpate_trajectories": "point",
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "family",
    [
        *(pytest.param(name, marks=pytest.mark.gate if name in NEEDED else ()) for name in FAMILIES),
        pytest.param("palpate_arms", marks=pytest.mark.gate),
        "openpyxl",
        pytest.param("lz4", marks=pytest.mark.gate),
        "google.protobuf",
    ],
)
def test_without_a_family(family, root, tmp_path):
    """Its package cannot be imported: that is said; all other commands answer, and a run names the part it lacks.

    Arms, and the libraries of formats, are imported where they are used; a run that does without says nothing.
    """
    command = [sys.executable, "-c", WITHOUT, family, root / "pipelines" / "filters.toml", tmp_path / "run"]
    plain = {**os.environ, "TYPER_USE_RICH": "0"}  # frames around fifty helps would take most of the time
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=tmp_path, env=plain)
    assert "--help ended with" not in done.stdout
    assert ("ModuleNotFoundError" in done.stderr) == (family in FAMILIES)
    assert "Traceback" not in done.stderr
    if family in NEEDED:
        assert done.returncode == 2
        assert NEEDED[family] in done.stderr
    else:
        assert done.returncode == 0, done.stderr
        assert (tmp_path / "run" / "result.json").is_file()
