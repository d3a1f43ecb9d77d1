"""The core knows no plugin by name, and works without any one family of analyses."""

import ast
import re
import shutil
import subprocess
import sys

import pytest
from palpate.registry import load

ANALYSES = [
    "palpate_calibration",
    "palpate_hardware",
    "palpate_indentation",
    "palpate_live",
    "palpate_maps",
    "palpate_notebook",
    "palpate_report",
    "palpate_studies",
    "palpate_testing",
    "palpate_uncertainty",
]
LIBRARIES = {"filterpy", "csv", "mcap", "point", "live"}  # words that are libraries, formats or plain English, too


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
        for path in sorted((root / "core").rglob("*.py"))
        if "testing" not in path.parts
        for text in strings(path)
        if quoted.search(text)
    ]
    assert not found


# What others wrote is imported once; each run is a fork that imports all of palpate anew, without one of its families.
WITHOUT = """
import gc, os, sys
from pathlib import Path
import casadi, llvmlite.binding, numpy, pydantic, rich.console, scipy.ndimage, scipy.optimize, typer
import importlib.metadata, json, mcap.reader, mcap.writer, rich.markdown, rich.progress, rich.table, tomllib
gc.collect()
gc.freeze()
pipeline, out, *families = sys.argv[1:]
for family in families:
    child = os.fork()
    if child:
        Path(out, family + ".code").write_text(str(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])))
        continue
    class Gone:
        def find_spec(self, name, path=None, target=None):
            if name.partition(".")[0] == family:
                raise ModuleNotFoundError(name)
    sys.meta_path.insert(0, Gone())
    os.dup2(os.open(Path(out, family + ".errors"), os.O_CREAT | os.O_WRONLY), 2)
    sys.argv = ["palpate", "run", pipeline, "--out", str(Path(out, family))]
    sys.argv += ["--set", "trajectory.press.duration=2 s", "--set", 'run.tracks=["dr/ekf"]']
    assert not [name for name in sys.modules if name.startswith("palpate")]
    from palpate.cli import main
    main()
    sys.exit(0)
"""


@pytest.fixture(scope="module")
def without(root, tmp_path_factory):
    """A folder with what a run did without each of the families: its run folder, its exit code and its errors."""
    out = tmp_path_factory.mktemp("without")
    pipeline = shutil.copy(root / "pipelines" / "point.toml", out)
    command = [sys.executable, "-c", WITHOUT, pipeline, out, *ANALYSES]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, cwd=out)
    assert done.returncode == 0, done.stderr
    return out


@pytest.mark.slow
@pytest.mark.parametrize("family", ANALYSES)
def test_a_run_without_a_family_of_analyses(family, without):
    """The family's package cannot be imported: what fails is told, and the run goes on."""
    errors = (without / f"{family}.errors").read_text()
    assert (without / f"{family}.code").read_text() == "0", errors
    assert (without / family / "result.json").is_file()
    assert "could not be loaded: ModuleNotFoundError" in errors
