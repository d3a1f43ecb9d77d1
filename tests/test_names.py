"""Names: files, classes and public functions are called by nouns and verbs of the field, and one name is one class."""

import ast
import re
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PRODUCT = sorted(path for folder in ("core", "plugins") for path in (ROOT / folder).rglob("*.py"))
# Participles and idioms that once stood for a thing, and that nobody looks for.
_LIST = """
    asked begun blame conclude concluding doubts drawn failing fed felt found gave giving given gone heard held kept
    known led looked looking lost made misheard readying said seen shown sought stubbed taken telling told unheard
    unlike untold wanted way willing written
"""
PLAIN_WORDS = set(_LIST.split())
EXCEPTIONS = {
    "held_samples": "samples that are held back",
    "HeldSamples": "the same",
    "held_out": "the field's word for data that a fit was not given",
}
# Classes that mean the same wherever they stand, or are written twice for type checkers.
SHARED_NAMES = {"Base", "Cdr", "Quantity"}


def words(name):
    """The words of a snake_case or CamelCase name."""
    return re.findall(r"[a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower())


@pytest.fixture(scope="module")
def names():
    """Kind, name and place of every file, and of every class and public function at the top of one."""
    found = []
    for path in PRODUCT:
        place = path.relative_to(ROOT)
        found.append(("file", path.stem, place))
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef):
                found.append(("class", node.name.lstrip("_"), place))
            elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                found.append(("function", node.name, place))
    return found


@pytest.mark.parametrize("kind", ["file", "class", "function"])
def test_no_participle_and_no_idiom(names, kind):
    odd = [
        f"{place}: {kind} {name}"
        for which, name, place in names
        if which == kind and name not in EXCEPTIONS and PLAIN_WORDS & set(words(name))
    ]
    assert not odd


def test_one_name_is_one_class(names):
    places = defaultdict(list)
    for kind, name, place in names:
        if kind == "class" and name not in SHARED_NAMES:
            places[name].append(str(place))
    assert not {name: where for name, where in places.items() if len(where) > 1}
