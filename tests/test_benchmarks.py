"""Benchmarks find what they measure; the measuring itself is not for tests."""

import pytest

from tests import processes

_IMPORTED = """
import importlib.util, pathlib, sys
sys.path[:0] = ["benchmarks", "."]
for file in sorted(pathlib.Path("benchmarks").glob("*.py")):
    spec = importlib.util.spec_from_file_location(file.stem, file)
    module = sys.modules[file.stem] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
        print(file.stem)
    except ModuleNotFoundError as error:
        if error.name.partition("_")[0] in ("palpate", "tests"):
            raise
        print(file.stem, "needs", error.name)
"""


@pytest.mark.slow
def test_every_benchmark_imports_what_there_is(root):
    """Names that have moved; a package of others that is not installed is no fault of a benchmark."""
    done = processes.run(_IMPORTED, cwd=root)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == len(list((root / "benchmarks").glob("*.py")))
