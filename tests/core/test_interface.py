"""The promised interface: its names are there, its number is understood, and what goes is named."""

import importlib
import json
import re
from pathlib import Path

import palpate
import pytest
from palpate import interface

ROOT = Path(__file__).parents[2]
ROW = re.compile(r"^\| `(palpate_[\w.]+)` \| (`.*`) \|$", re.MULTILINE)
PROMISED = [
    (module, name)
    for module, names in ROW.findall((ROOT / "docs" / "versions.md").read_text())
    for name in re.findall(r"`(\w+)`", names)
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


def test_there_are_promised_names():
    assert len(PROMISED) == 38


@pytest.mark.parametrize(("module", "name"), PROMISED)
def test_a_promised_name_is_there(module, name):
    assert hasattr(importlib.import_module(module), name)


@pytest.mark.parametrize(
    "folder", ["distributions", "tests/third_party", "plugins/commands/palpate_commands/distribution"]
)
def test_distributions_and_templates_use_promised_names(folder):
    importing = re.compile(r"^ *from (palpate_(?:kit|records|arms)[\w.]*) import ([\w, ]+)$", re.MULTILINE)
    files = [*(ROOT / folder).rglob("*.py"), *(ROOT / folder).rglob("*.txt")]
    used = {
        (module, name.strip().partition(" as ")[0])
        for file in files
        for module, names in importing.findall(file.read_text())
        for name in names.split(",")
    }
    assert used - set(PROMISED) - {("palpate_arms.arm_driver", "KINEMATICS_TOLERANCE")} == set()


def test_a_plugin_of_the_present_number_takes_part(palpate, site):
    shown = json.loads(palpate("list", "--plugins", "--json", PYTHONPATH=site()).stdout)
    assert shown["interface"] == interface.API == 1
    (row,) = [row for row in shown["plugins"] if row["name"].startswith("soft-lab")]
    assert row == {"name": "soft-lab 1.0 (soft_lab)", "interface": 1, "deprecated": []}


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


def test_the_number_is_public():
    assert palpate.API == 1
