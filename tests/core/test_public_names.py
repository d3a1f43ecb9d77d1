"""The public interfaces have no name that nobody needs."""

import importlib
import re
from pathlib import Path

import palpate
import palpate_engine
import pytest

ROOT = Path(__file__).parents[2]
CORE = {ROOT / "core" / "palpate", ROOT / "core" / "palpate_engine"}


def texts():
    """Everything but core and engine: code of plugins, distributions and the kit, documents, examples and tests."""
    for folder in ("core", "plugins", "distributions", "docs", "tests", "benchmarks"):
        for path in (ROOT / folder).rglob("*"):
            inside = (
                not set(CORE).isdisjoint(path.parents) or path.name == Path(__file__).name or "decisions" in path.parts
            )
            if path.suffix in (".py", ".md") and not inside:
                yield path.read_text(encoding="utf-8")
    yield (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def words():
    return set(re.findall(r"\w+", "\n".join(texts())))


@pytest.mark.parametrize("interface", [palpate, palpate_engine])
def test_every_public_name_is_there_and_used_outside_of_the_core(words, interface):
    names = interface.__all__
    assert 50 < len(names) < 173
    assert [name for name in names if not hasattr(interface, name)] == []
    assert set(names) - words == set()


def test_the_former_name_of_the_engine_has_its_names_for_this_release():
    with pytest.warns(DeprecationWarning, match="import from palpate_engine"):
        host = importlib.import_module("palpate.host")
    assert all(getattr(host, name) is getattr(palpate_engine, name) for name in palpate_engine.__all__)
