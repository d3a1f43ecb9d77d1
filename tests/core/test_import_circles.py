"""No file of a package imports itself by way of others, wherever in the file, and for whatever, it imports them."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = sorted(init.parent for init in (*ROOT.glob("core/*/__init__.py"), *ROOT.glob("plugins/*/*/__init__.py")))


def module_of(file, package):
    parts = file.relative_to(package.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports_of(text):
    """What a file imports, its functions and `if TYPE_CHECKING` included, each by the longest name it may have."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{name.name}" for name in node.names)


def graph_of(package):
    """The files of a package that each of them imports; a name of a file that is none of them belongs to the file."""
    files = {module_of(file, package): file for file in package.rglob("*.py")}
    found = {}
    for module, file in files.items():
        names = [name if name in files else name.rpartition(".")[0] for name in imports_of(file.read_text())]
        found[module] = {name for name in names if name in files and name != module}
    return found


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
def test_no_file_imports_itself_by_way_of_others(package):
    TopologicalSorter(graph_of(package)).prepare()  # raises CycleError with the files


def test_every_package_is_looked_at_and_a_circle_would_show(tmp_path):
    assert {"palpate", "palpate_kit", "palpate_fits", "palpate_notebook"} <= {package.name for package in PACKAGES}
    (tmp_path / "p").mkdir()
    (tmp_path / "p" / "one.py").write_text("if TYPE_CHECKING:\n    from p.two import Two\n")
    (tmp_path / "p" / "two.py").write_text("def two():\n    from p import one\n")
    (tmp_path / "p" / "__init__.py").write_text("")
    assert graph_of(tmp_path / "p") == {"p": set(), "p.one": {"p.two"}, "p.two": {"p.one"}}
    with pytest.raises(ValueError, match="cycle"):
        TopologicalSorter(graph_of(tmp_path / "p")).prepare()
