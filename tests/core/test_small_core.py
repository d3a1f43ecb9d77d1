"""The core knows no plugin by name, and works without any one family of analyses."""

import ast
import re
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


@pytest.mark.parametrize("family", ANALYSES)
def test_a_run_without_a_family_of_analyses(family, point_pipeline, tmp_path):
    """The family's package cannot be imported: what fails is told, and the run goes on."""
    script = (
        "import sys\n"
        "class Gone:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name.partition('.')[0] == {family!r}:\n"
        "            raise ModuleNotFoundError(name)\n"
        "sys.meta_path.insert(0, Gone())\n"
        f"sys.argv = ['palpate', 'run', {str(point_pipeline)!r}, '--out', {str(tmp_path / 'out')!r},"
        " '--set', 'trajectory.press.duration=2 s', '--set', 'run.tracks=[\"dr/ekf\"]']\n"
        "from palpate.cli import main\n"
        "main()\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "result.json").is_file()
    assert "could not be loaded: ModuleNotFoundError" in done.stderr
