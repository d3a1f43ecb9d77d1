"""The first second: what is looked up imports neither numbers nor parts, and every public name is still there."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
LAZY = [
    "palpate",
    *(f"palpate_{family}" for family in ("devices", "filters", "fits", "logs", "models", "notebook", "ros2")),
    *(f"palpate_{family}" for family in ("simulation", "surfaces", "testing", "trajectories")),
]
SLOW = ("numpy", "pydantic", "typer", "rich", "casadi", "scipy")


@pytest.mark.parametrize(("argument", "slow"), [("--version", SLOW), ("--help", (*SLOW, "importlib.metadata"))])
def test_looking_up_imports_neither_numbers_nor_parts(argument, slow):
    script = (
        "import sys\nfrom palpate_engine.cli import main\n"
        f"main([{argument!r}])\n"
        f"sys.exit(' '.join(name for name in {slow!r} if name in sys.modules))\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120)
    assert done.stderr.strip() == ""
    assert done.stdout


@pytest.mark.slow
def test_a_run_of_a_simulated_point_imports_no_scipy(tmp_path):
    script = (
        "import sys\nfrom palpate_engine.cli import call\n"
        f"call(['run', {str(ROOT / 'pipelines' / 'point.toml')!r}, '--out', {str(tmp_path / 'run')!r}])\n"
        "sys.exit('imports scipy' if 'scipy' in sys.modules else 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr[-300:]
    assert (tmp_path / "run" / "result.json").exists()


@pytest.mark.parametrize("name", LAZY)
def test_every_public_name_is_there_and_type_checkers_see_it(name):
    module = importlib.import_module(name)
    for public in module.__all__:
        assert getattr(module, public) is not None
    file = Path(module.__file__)
    tree = ast.parse(next(path for path in (file.with_suffix(".pyi"), file) if path.exists()).read_text())
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    places = [(node, f"{name}.{node.module}" if node.level else node.module) for node in nodes]
    seen = {alias.name: place for node, place in places for alias in node.names}
    assert module.__all__
    assert set(module.__all__) - set(seen) == set(), f"to be imported below TYPE_CHECKING in {file}"
    for public in module.__all__:
        place = importlib.import_module(seen[public])
        found = (
            getattr(place, public) if hasattr(place, public) else importlib.import_module(f"{place.__name__}.{public}")
        )
        assert found is getattr(module, public)


def test_a_name_that_is_not_there():
    with pytest.raises(ImportError, match="cannot import name 'Spere'"):
        exec("from palpate_models import Spere")
    with pytest.raises(AttributeError, match="palpate_models has no 'Spere'; did you mean 'Sphere'"):
        _ = importlib.import_module("palpate_models").Spere
