"""English: what is said in sentences, with the words of an engineer; CONTRIBUTING lists what is not written."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FOLDERS = ("core", "plugins", "benchmarks", "docs", "pipelines", "distributions")
CODE = {".js", ".c", ".h"}
PROSE = {".md", ".toml", ".txt", ".html", ".mplstyle"}
_HEAD = "| not | but |\n"
_CODE_PROSE = re.compile(r"/\*.*?\*/|//[^\n]*|\"[^\"\n]*\"|`[^`]*`", re.DOTALL)
# Expressions in texts of JavaScript and in templates, and names in backticks: they are code.
_INSERTED = re.compile(r"\$\{[^{}]*\}|\{[{%].*?[%}]\}|`[^`\s]+`")
_BETWEEN = r"(?:\W+|\W+f\W+)"  # words of a phrase: a line may end there, or one text and the next begin
_COMMENT = re.compile(r"^([^\n]*?)(?:^|\s)#(.*)$", re.MULTILINE)


@cache
def list_of_phrases() -> tuple[tuple[str, ...], str]:
    """The phrases that CONTRIBUTING lists, and CONTRIBUTING without them."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    before, _, rest = text.partition(_HEAD)
    table, gap, after = rest.partition("\n\n")
    rows = table.splitlines()[1:]
    return tuple(phrase.strip() for row in rows for phrase in row.split("|")[1].split(",")), before + gap + after


def pattern_of(phrases: tuple[str, ...]) -> re.Pattern[str]:
    """Any of the phrases as whole words, at the beginning of a sentence as well."""
    words = (r"\s+".join(phrase.split()) for phrase in phrases)
    return re.compile(r"(?<![\w-])(?:" + "|".join(f"[{w[0].upper()}{w[0]}]{w[1:]}" for w in words) + r")(?![\w-])")


def may_have(text: str, phrases: tuple[str, ...]) -> bool:
    """Whether a text has the words of a phrase one after the other, whatever stands between them: a quick look."""
    rows = (form.split() for phrase in phrases for form in (phrase, phrase.capitalize()))
    return any(all(word in text for word in words) and re.search(_BETWEEN.join(words) + r"\b", text) for words in rows)


def sentences(path: Path, text: str) -> Iterator[str]:
    """What a file says to its readers: docstrings, comments and texts of code; all of a document."""
    if path.suffix in (".py", ".pyi"):
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
                yield _INSERTED.sub("", node.value)
        yield _COMMENT.sub(r"\2", "\n".join(line if "#" in line else "" for line in text.splitlines()))
    elif path.suffix in CODE:
        yield from _CODE_PROSE.findall(_INSERTED.sub("", text))
    else:
        yield _INSERTED.sub("", text)


def files() -> Iterator[tuple[Path, str]]:
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*")):
            known = path.suffix in {".py", ".pyi", *CODE, *PROSE} and not {"decisions", "uplot"} & {*path.parts}
            if known and ROOT / "docs" / "reference" not in path.parents:  # made by the build of the site
                yield path, path.read_text()
    yield ROOT / "CONTRIBUTING.md", list_of_phrases()[1]
    for name in ("README.md", "SECURITY.md"):
        yield ROOT / name, (ROOT / name).read_text()


@pytest.fixture(scope="module")
def odd() -> list[str]:
    """Every listed phrase in what is said, with its file."""
    phrases, _ = list_of_phrases()
    said = pattern_of(phrases)
    return [
        f"{path.relative_to(ROOT)}: {found}"
        for path, text in files()
        if may_have(text, phrases)
        for sentence in sentences(path, text)
        for found in said.findall(sentence)
    ]


def test_the_list_is_read():
    assert {"told", "is wanted", "there is no", "anew", "on trust"} <= {*list_of_phrases()[0]}


def test_nothing_is_said_as_it_is_not_written(odd):
    assert not odd
