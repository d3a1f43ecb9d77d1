"""The public interfaces have no name that nobody needs."""

import re
from pathlib import Path

import palpate
import pytest
from palpate import host

ROOT = Path(__file__).parents[2]
CORE = ROOT / "core" / "palpate"
STUB = re.findall(r"\b(\w+) as \1\b", (CORE / "__init__.pyi").read_text())


def texts():
    """Everything but the core: code of plugins and of the kit, documents, examples and tests."""
    for folder in ("core", "plugins", "docs", "tests", "benchmarks"):
        for path in (ROOT / folder).rglob("*"):
            inside = CORE in path.parents or path.name == Path(__file__).name or "decisions" in path.parts
            if path.suffix in (".py", ".md") and not inside:
                yield path.read_text(encoding="utf-8")
    yield (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def words():
    return set(re.findall(r"\w+", "\n".join(texts())))


@pytest.mark.parametrize(("interface", "names"), [(palpate, STUB), (host, host.__all__)], ids=["palpate", "host"])
def test_every_public_name_is_there_and_used_outside_of_the_core(words, interface, names):
    assert len(names) > 50
    assert [name for name in names if not hasattr(interface, name)] == []
    assert set(names) - words == set()
