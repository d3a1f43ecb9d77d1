"""Decisions have one form, one number each, and stand in the index."""

import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent.parent / "docs" / "decisions"
PAGES = sorted(FOLDER.glob("[0-9]*.md"))


def test_each_number_is_given_once():
    numbers = [page.name[:4] for page in PAGES]
    assert len(set(numbers)) == len(numbers)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_its_form(page):
    text = page.read_text()
    number, title = re.match(r"# (\d{4}): (.+)\n\n\*\*Status\.\*\* \w", text).groups()
    assert number == page.name[:4]
    assert [line for line in text.splitlines() if line.startswith("## ")] == [
        "## Context",
        "## Decision",
        "## Consequences",
    ]
    assert f"| [{number}]({page.name}) | {title} |" in (FOLDER / "README.md").read_text()


def test_what_was_replaced_is_a_row_and_no_page():
    """A replaced decision keeps its number in one table; its page would be read as if it held."""
    replaced = [page.name for page in PAGES if re.search(r"\*\*Status\.\*\* (Replaced|Superseded)", page.read_text())]
    assert replaced == []
    rows = re.findall(
        r"^\| (\d{4}) \| .+ \| \[(\d{4})\]\((.+)\) \| .+ \|$", (FOLDER / "replaced.md").read_text(), re.MULTILINE
    )
    assert rows
    numbers = {page.name[:4]: page.name for page in PAGES}
    for number, by, name in rows:
        assert number not in numbers
        assert numbers[by] == name
