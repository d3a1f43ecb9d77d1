"""Every block of code in the documents: pipelines against the schema, Python compiled, commands against what there is.

The blocks of plugins/*/README.md are run by test_plugin_readmes, those of docs/tutorials when the site is built.
"""

import ast
import re
import shlex
import tomllib
from itertools import filterfalse
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import typer
from palpate_commands.schema import pipeline_schema
from palpate_engine import RigFacts, facts_of, function_of, registry
from palpate_engine.cli.commands import call_of, parse_arguments

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
CELL = re.compile(r"^```\{code-cell\}[^\n]*\n(?::[^\n]*\n)*(.*?)^```$", re.MULTILINE | re.DOTALL)
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(*kinds):
    found = []
    for page in PAGES:
        for number, (kind, text) in enumerate(BLOCK.findall(page.read_text())):
            if kind in kinds:
                found.append(pytest.param(text, id=f"{page.name}-{number}"))
    return found


def without_required(schema: Any) -> Any:
    """A block may be a part of a pipeline."""
    if isinstance(schema, dict):
        return {key: without_required(value) for key, value in schema.items() if key != "required"}
    return [without_required(item) for item in schema] if isinstance(schema, list) else schema


@pytest.fixture(scope="module")
def validator():
    return jsonschema.Draft202012Validator(without_required(pipeline_schema(registry.load())))


def of_rig(block):
    return block.id.startswith("rig-facts")


@pytest.mark.parametrize("text", list(filter(of_rig, blocks("toml"))))
def test_facts_of_a_rig_are_read(text):
    assert facts_of(tomllib.loads(text)).tip


def test_every_key_of_a_rig_has_its_line_on_the_page_of_them():
    page = (ROOT / "docs" / "rig-facts.md").read_text()
    assert [key for key in RigFacts.model_fields if f"`{key}`" not in page] == []


@pytest.mark.parametrize("text", list(filterfalse(of_rig, blocks("toml"))))
def test_pipelines_are_what_the_schema_allows(text, validator):
    mistakes = [f"{list(error.absolute_path)}: {error.message}" for error in validator.iter_errors(tomllib.loads(text))]
    assert not mistakes


@pytest.mark.parametrize("text", blocks("python"))
def test_python_is_python(text):
    compile(text, "block", "exec")


def options(name):
    app = typer.Typer(add_completion=False)
    app.command(name=name)(function_of(registry.load_commands().command(name)))
    return {option for parameter in typer.main.get_command(app).params for option in parameter.opts} | {"--help", "-h"}


def assert_is_there(words):
    """That a command exists, with the options that are given."""
    meant = call_of(parse_arguments(words))
    given = {word.partition("=")[0] for word in meant.arguments if re.match(r"--?[a-z]", word)}
    assert given <= options(meant.name), meant.name


@pytest.mark.parametrize("text", blocks("sh", "bash"))
def test_commands_and_their_options_are_there(text):
    for line in text.replace("\\\n", " ").splitlines():
        for call in re.findall(r"(?:^|&&|\||;)\s*(?:\S*/)?palpate ([^|&;]*)", line.partition(" #")[0]):
            words = [word for word in shlex.split(call) if word != "--no-plugins"]
            if words and not words[0].startswith("-"):
                assert_is_there(words)


def calls(text):
    """The words of every call of palpate in the cells of a tutorial, up to the first that is computed."""
    for cell in CELL.findall(text):
        for node in ast.walk(ast.parse(cell)):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "palpate":
                words = []
                for argument in node.args:
                    part = argument.values[0] if isinstance(argument, ast.JoinedStr) else argument
                    if not isinstance(part, ast.Constant) or not isinstance(part.value, str):
                        break
                    words += part.value.replace("'", "").split()[:2] if part is not argument else [part.value]
                yield shlex.split(words[0]) if len(node.args) == 1 and len(words) == 1 else words


@pytest.mark.parametrize("page", TUTORIALS, ids=[page.stem for page in TUTORIALS])
def test_commands_of_a_tutorial_are_there(page):
    for words in calls(page.read_text()):
        assert_is_there(words)
