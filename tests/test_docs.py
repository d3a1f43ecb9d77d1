"""The documents keep up with the code."""

from pathlib import Path

import pytest
from palpate import hooks
from palpate.cli.commands import offered
from palpate.registry import load

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()


@pytest.mark.parametrize("command", sorted(offered().commands))
def test_the_readme_names_every_command(command):
    assert f"`palpate {command}" in README


@pytest.mark.parametrize(("hook", "root"), [*hooks.KINDS.values(), *hooks.EXTENSIONS.values()])
def test_every_hook_is_documented(hook, root):
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
