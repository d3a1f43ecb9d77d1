"""The promised interface: its names are there, its number is understood, and what goes is named."""

import importlib
import json
import re
from pathlib import Path

import palpate
import pytest
from palpate import interface

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "versions.md").read_text()
NAMES = re.compile(r"`(\w+)`")
PROMISED = [(module, name) for module, names in interface.PROMISED.items() for name in names]
OF_HOOKS = [
    name
    for names in re.findall(r"^- of [a-z ]+: (`.*(?:\n  `.*)*)$", PAGE, re.MULTILINE)
    for name in NAMES.findall(names)
]
TIP = """
from palpate import Indenter, plugin
PALPATE_API = {api}
{more}
class Flat(Indenter):
    '''A flat punch.'''
    def contact_radius(self, depth):
        return 0.005 + 0 * depth
@plugin
def palpate_indenters():
    return {{"own-flat": Flat}}
"""


@pytest.fixture
def site(tmp_path):
    """Install a distribution "soft-lab 1.0" of a text; the folder for the import path."""

    def make(api=1, more=""):
        info = tmp_path / "site" / "soft_lab-1.0.dist-info"
        info.mkdir(parents=True)
        (tmp_path / "site" / "soft_lab.py").write_text(TIP.format(api=api, more=more))
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: soft-lab\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text("[palpate]\nsoft_lab = soft_lab\n")
        return str(tmp_path / "site")

    return make


def test_the_page_lists_what_is_promised():
    listed = re.findall(r"^- `(palpate_[\w.]+)`: (`.*`)$", PAGE, re.MULTILINE)
    assert {module: tuple(NAMES.findall(names)) for module, names in listed} == interface.PROMISED
    assert f"and {len(interface.NOT_PROMISED)} that palpate's own" in PAGE


def test_each_name_of_palpate_has_one_place():
    """Names of few hooks and those that are not promised are public, and no name is in both lists or twice in one."""
    assert len(OF_HOOKS) > 60
    assert len(set(OF_HOOKS)) == len(OF_HOOKS)
    assert set(OF_HOOKS) | interface.NOT_PROMISED <= set(palpate.__all__)
    assert not set(OF_HOOKS) & interface.NOT_PROMISED


@pytest.mark.parametrize(("module", "name"), PROMISED)
def test_a_promised_name_is_there(module, name):
    assert hasattr(importlib.import_module(module), name)


@pytest.mark.parametrize(
    ("folder", "ending"),
    [
        ("distributions", "py"),
        ("tests/third_party", "py"),
        ("plugins/commands/palpate_commands/distribution", "txt"),
        ("docs", "md"),
        ("plugins", "README.md"),
    ],
)
def test_distributions_templates_and_pages_use_promised_names(folder, ending, tmp_path):
    """What an author reads and copies uses no other name of core, kit, records and arms."""
    texts = [
        path.read_text()
        for path in (ROOT / folder).rglob(f"*{ending}")
        if "tests" not in path.parts[len(ROOT.parts) + 2 :]
    ]
    if ending.endswith("md"):
        texts = [
            block
            for text in texts
            for block in re.findall(r"^```python\n# file: (?!test_).*\n((?:.|\n)*?)^```", text, re.MULTILINE)
        ]
    assert texts
    for text in texts:
        (tmp_path / "own.py").write_text(text)
        assert [use.name for use in interface.unpromised_uses(str(tmp_path / "own.py"))] == [], text


def test_a_plugin_of_the_present_number_takes_part(palpate, site):
    shown = json.loads(palpate("list", "--plugins", "--json", PYTHONPATH=site()).stdout)
    assert shown["interface"] == interface.API == 1
    (row,) = [row for row in shown["plugins"] if row["name"].startswith("soft-lab")]
    assert row == {"name": "soft-lab 1.0 (soft_lab)", "interface": 1, "deprecated": [], "not_promised": []}


@pytest.mark.parametrize("api", [99, 0, "'one'"])
def test_an_unknown_number_leaves_an_installed_plugin_out(palpate, site, point_pipeline, api):
    folder = site(api)
    done = palpate("check", point_pipeline, PYTHONPATH=folder)
    assert done.returncode == 0, done.stderr
    sentence = f"plugin soft-lab 1.0 (soft_lab) is left out: PALPATE_API is {api}, and this palpate knows 1"
    assert done.stderr.count(sentence) == 1
    used = palpate("check", point_pipeline, "--set", "indenter.tip={type='own-flat'}", PYTHONPATH=folder)
    assert used.returncode == 2
    assert sentence in used.stderr


def test_an_unknown_number_of_a_file_is_a_mistake_of_its_user(palpate, point_pipeline):
    (point_pipeline.parent / "own.py").write_text(TIP.format(api=99, more=""))
    done = palpate("check", point_pipeline, "--set", 'run.plugins=["own.py"]')
    assert done.returncode == 2
    assert "PALPATE_API is 99, and this palpate knows 1" in done.stderr


@pytest.mark.filterwarnings("ignore:import from palpate_engine instead of palpate.host:DeprecationWarning")
def test_deprecated_names_are_found_with_the_version_in_which_they_go(palpate, site):
    shown = palpate(
        "list", "--plugins", PYTHONPATH=site(more="def later():\n    from palpate.host import load_pipeline")
    )
    assert "soft-lab 1.0 (soft_lab): interface 1" in shown.stdout
    assert "palpate.host (soft_lab.py, line 5) goes in 0.3.0: import from palpate_engine" in shown.stdout


@pytest.mark.parametrize(
    ("line", "name"),
    [
        ("from palpate import use_clock, Length", "palpate.use_clock"),
        ("from palpate.registry import load", "palpate.registry.load"),
        ("from palpate_engine.config import load_pipeline", "palpate_engine.config.load_pipeline"),
        ("from palpate_kit.terminal.table import Table, Column", "palpate_kit.terminal.table.Column"),
        ("import palpate_kit.terminal.table", "palpate_kit.terminal.table"),
    ],
)
def test_names_that_nobody_promises_are_found(palpate, site, line, name):
    folder = site(more=f"def later():\n    {line}")
    shown = palpate("list", "--plugins", PYTHONPATH=folder)
    expected = f"    {name} (soft_lab.py, line 5) is not promised: it may change with any version"
    assert [row for row in shown.stdout.splitlines() if "is not promised" in row] == [expected]


def test_the_number_is_public():
    assert palpate.API == 1
