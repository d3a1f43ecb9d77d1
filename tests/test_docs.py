"""The documents keep up with the code."""

import re
from pathlib import Path

import pytest
from palpate import hooks
from palpate.cli import app
from palpate.registry import load

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()
SOURCES = [path.read_text() for path in sorted((ROOT / "core").rglob("*.py"))]


@pytest.mark.parametrize(
    "code", sorted({code for text in SOURCES for code in re.findall(r'\bflag\(\s*"([a-z-]+)"', text)})
)
def test_the_readme_explains_every_flag(code):
    assert f"`{code}`" in README


@pytest.mark.parametrize("command", sorted(command.name for command in app.registered_commands))
def test_the_readme_names_every_command(command):
    assert f"`palpate {command}" in README


@pytest.mark.parametrize("kind", sorted(hooks.KINDS))
def test_every_hook_is_documented(kind):
    hook, root = hooks.KINDS[kind]
    assert getattr(hooks, hook).__doc__
    assert root.__doc__


@pytest.mark.parametrize(("kind", "name"), [(k, n) for k, entries in load().parts.items() for n in entries])
def test_every_part_says_what_it_is(kind, name):
    part = load().find(kind, name)
    first = part.__doc__.strip().splitlines()[0]
    assert first.endswith(".")
    for key, field in part.model_fields.items():
        assert field.description, f"{name}.{key} has no description"


def test_decisions_are_numbered_without_repetition():
    numbers = [path.name[:4] for path in sorted((ROOT / "docs" / "decisions").glob("*.md"))]
    assert len(set(numbers)) == len(numbers)
