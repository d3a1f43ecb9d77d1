"""What a plugin's module imports where palpate looks for plugins."""

import pytest
from palpate_testing import check_discovery


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Write a package `own_lab` of two modules onto the import path."""

    def write(module, tip):
        (tmp_path / "own_lab").mkdir()
        (tmp_path / "own_lab" / "__init__.py").write_text(module)
        (tmp_path / "own_lab" / "tip.py").write_text(tip)
        monkeypatch.syspath_prepend(tmp_path)

    return write


def test_the_distribution_of_the_franka_waits_for_no_library(root, monkeypatch):
    monkeypatch.syspath_prepend(root / "distributions" / "palpate-franka")
    check_discovery("palpate_franka")


@pytest.mark.parametrize(
    ("module", "place"),
    [
        ("import numpy as np\n", r"numpy \(__init__.py, line 1\)"),
        ("from own_lab.tip import Own\n", r"numpy \(tip.py, line 2\)"),
        ("from palpate import Indenter\n", r"numpy \(__init__.py, line 1\)"),
    ],
)
def test_the_line_that_imports_numpy_is_named(package, module, place):
    package(module, "import json\nimport numpy as np\nclass Own:\n    pass\n")
    with pytest.raises(AssertionError, match=f"own_lab imports .*{place}.* before every command"):
        check_discovery("own_lab")


def test_a_module_that_cannot_be_imported(package):
    package("import nothing_like_this\n", "")
    with pytest.raises(AssertionError, match="own_lab cannot be imported: ModuleNotFoundError"):
        check_discovery("own_lab")
