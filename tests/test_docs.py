"""The documents keep up with the code."""

import re
import tomllib
from pathlib import Path

import pytest
from palpate import hooks
from palpate.plugin_switch import only_plugins
from palpate.registry import load
from palpate_engine.cli.commands import command_offers
from palpate_engine.config.file_version import FORMAT
from palpate_engine.result.result_folder import SCHEMA

ROOT = Path(__file__).parent.parent
COMMANDS = (ROOT / "docs" / "commands.md").read_text()
with only_plugins("off"):  # whatever else is installed
    SHIPPED = sorted(command_offers().commands)


@pytest.mark.parametrize("command", SHIPPED)
def test_the_page_of_commands_names_every_one(command):
    assert f"`palpate {command}" in COMMANDS


_OFFERED = [("palpate_offers", root) for _, root in hooks.OFFERS.values()]


@pytest.mark.parametrize(("hook", "root"), [*hooks.KINDS.values(), *hooks.EXTENSIONS.values(), *_OFFERED])
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


def test_the_readme_is_one_screen_and_its_links_lead_somewhere():
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) < 90
    assert len(text.split()) < 700
    links = re.findall(r"\]\(([^)#]+)\)", text)
    assert links
    for link in links:
        assert link.startswith("https://") or (ROOT / link).exists(), link


DOCUMENTS = sorted(
    path
    for folder in (".", "benchmarks", "docs", "plugins")
    for path in (ROOT.glob("*.md") if folder == "." else (ROOT / folder).rglob("*.md"))
    if ROOT / "docs" / "reference" not in path.parents
)


def anchors(page):
    """What a link to a page can name: its headings, as GitHub and the site write them, and its labels."""
    text = page.read_text()
    titles = (re.sub(r"[^\w\- ]", "", title.lower()) for title in re.findall(r"^#+ (.+)$", text, re.MULTILINE))
    return {title.replace(" ", "-") for title in titles} | set(re.findall(r"^\(([\w-]+)\)=$", text, re.MULTILINE))


@pytest.mark.parametrize("page", DOCUMENTS, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_to_files_and_headings(page):
    """The site's build looks at its own pages only; reference pages are written by it."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    for link in re.findall(r"\]\(([^)\s:]+)\)", text):
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists() or "reference/" in path, link
        assert not anchor or anchor in anchors(target), link


def test_versions_agree():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    changes = (ROOT / "CHANGELOG.md").read_text()
    assert f"version: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert ".".join(version.split(".")[:2]) == FORMAT
    assert changes.startswith(f"# Changelog\n\n## {version}")
    assert f'palpate = "{FORMAT}"' in changes
    assert f"`result.json` has schema {SCHEMA} " in changes
    assert f'`"schema": {SCHEMA}`' in (ROOT / "docs" / "versions.md").read_text()


def test_the_changelog_is_that_of_a_release():
    assert len((ROOT / "CHANGELOG.md").read_text().splitlines()) <= 80


INDEXES = [ROOT / "docs" / name for name in ("index.md", "how-to.md", "reference.md", "background.md")]
PAGES = sorted([*(ROOT / "docs").glob("*.md"), *(ROOT / "docs" / "tutorials").glob("*.md")])


def entries(index):
    """The pages that an index names."""
    trees = re.findall(r"```\{toctree\}\n(.*?)```", index.read_text(), re.DOTALL)
    return [line for tree in trees for line in tree.splitlines() if line and not line.startswith(":")]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_page_is_on_the_site_once(page):
    """Those that no index names would be built, and found by nobody."""
    name = page.relative_to(ROOT / "docs").with_suffix("").as_posix()
    assert sum(entries(index).count(name) for index in INDEXES) == (name != "index")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_begins_with_what_its_reader_can_do(page):
    (first,) = re.findall(r"^# [^\n]+\n\n(.+?)(?:\. |\.\n|:\n|;)", page.read_text(), re.MULTILINE | re.DOTALL)[:1]
    assert "you can" in first


def test_the_documents_are_what_a_reader_finishes():
    """Words of site, README and families' READMEs, without decisions and what a program writes."""
    pages = [page for folder in ("docs", "plugins") for page in (ROOT / folder).rglob("*.md")]
    others = {ROOT / "docs" / "decisions", ROOT / "docs" / "reference"}
    written = [page for page in pages if others.isdisjoint(page.parents)]
    assert sum(len(page.read_text().split()) for page in [ROOT / "README.md", *written]) <= 50_000


def test_a_comment_of_a_code_block_goes_on_in_the_next_line():
    """Lines longer than a page of the site are wrapped: none ends at its edge."""
    settings = (ROOT / "docs" / "conf.py").read_text()
    (style,) = re.findall(r'html_css_files = \["(.+)"\]', settings)
    assert "white-space: pre-wrap" in (ROOT / "docs" / "_static" / style).read_text().partition("pre {")[2]


def test_the_first_level_of_the_site_is_short():
    """A reader who has just come sees where to begin."""
    assert len(entries(INDEXES[0])) <= 12


def test_the_pages_agree_on_how_often_a_log_is_flushed():
    from palpate_devices.log_recorder import FLUSH_EVERY
    from palpate_devices.mcap_sink import McapSink

    words = {4: "four", 5: "five", 6: "six", 7: "seven", 10: "ten"}[int(1 / FLUSH_EVERY)]
    for text in ((ROOT / "docs/logs.md").read_text(), (ROOT / "docs/results.md").read_text(), McapSink.__doc__):
        (said,) = re.findall(r"[Ff]lush(?:ed|es)(?: it)? (\w+) times", " ".join(text.split()))
        assert said == words
