"""Enter every package of ``core`` and ``plugins`` in ``pyproject.toml``: ``python plugins/make_pyproject.py``.

The folders are the list of families: one that is new, renamed or gone needs nothing but this.
"""

from pathlib import Path

import tomlkit
from tomlkit.items import Array

ROOT = Path(__file__).parent.parent
TOP = "palpate_notebook"  # the Python interface, which uses families


def page(text: str) -> str:
    """Return the text of ``pyproject.toml`` with all packages: entry points, wheel, type checkers, contracts of
    imports."""
    core = sorted(path.parent for path in ROOT.glob("core/*/__init__.py"))
    families = sorted(path.parent for path in ROOT.glob("plugins/*/palpate_*/__init__.py"))
    names = [path.name for path in (*core, *families)]
    folders = ["core", *(f"plugins/{path.parent.name}" for path in families)]
    document = tomlkit.parse(text)
    entries = {path.parent.name: path.name for path in families}
    document["project"]["entry-points"]["palpate"] = entries  # type: ignore[index]
    tool = document["tool"]
    tool["hatch"]["build"]["targets"]["wheel"]["packages"] = _lines(  # type: ignore[index]
        [str(path.relative_to(ROOT)) for path in (*core, *families)]
    )
    tool["mypy"]["packages"] = _lines(names)  # type: ignore[index]
    tool["mypy"]["mypy_path"] = ":".join(folders)  # type: ignore[index]
    tool["pyright"]["extraPaths"] = _lines(folders)  # type: ignore[index]
    linter = tool["importlinter"]  # type: ignore[index]
    linter["root_packages"] = _lines(names)  # type: ignore[index]
    layers, public = linter["contracts"][:2]  # type: ignore[index]
    below = [layer for layer in layers["layers"] if not {path.name for path in families} & set(layer.split(" | "))]
    layers["layers"] = _lines([TOP, " | ".join(entry for entry in entries.values() if entry != TOP), *below])
    public["source_modules"] = _lines([name for name in names if name not in {"palpate", "palpate_engine"}])
    return tomlkit.dumps(document)


def _lines(names: list[str]) -> Array:
    """Return an array with each name on a line of its own."""
    array = tomlkit.array().multiline(True)
    array.extend(names)
    return array


if __name__ == "__main__":
    file = ROOT / "pyproject.toml"
    file.write_text(page(file.read_text(encoding="utf-8")), encoding="utf-8")
