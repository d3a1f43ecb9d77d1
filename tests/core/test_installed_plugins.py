"""Plugins of installed distributions, as their files state them and as `importlib.metadata` does."""

import importlib.metadata
import sys

import pytest
from palpate.installed_plugins import installed_plugins


def write(site, folder, entries, headers=""):
    info = site / folder
    info.mkdir(parents=True)
    (info / "entry_points.txt").write_text(entries)
    if headers:
        (info / ("METADATA" if folder.endswith("dist-info") else "PKG-INFO")).write_text(headers)


def names(*places):
    return [(plugin.name, plugin.target) for plugin in installed_plugins(tuple(map(str, places)))]


def test_they_are_those_of_the_standard_library():
    entries = importlib.metadata.entry_points(group="palpate")
    expected = {(f"{entry.dist.name} {entry.dist.version} ({entry.name})", entry.value) for entry in entries}
    assert set(names(*sys.path)) == expected
    assert len(expected) > 20


@pytest.mark.parametrize(
    ("folder", "headers", "name"),
    [
        ("soft_lab-1.0.dist-info", "Metadata-Version: 2.1\nName: Soft-Lab\nVersion: 1.0\n\nVersion: 7", "Soft-Lab 1.0"),
        ("soft_lab.egg-info", "Metadata-Version: 1.1\nName: soft-lab\nVersion: 1.0\n", "soft-lab 1.0"),
        ("soft_lab-1.0-py3.11.egg-info", "Name: soft-lab\nVersion: 1.0\n", "soft-lab 1.0"),
        ("soft_lab-1.0.dist-info", "", "soft_lab 1.0"),
    ],
)
def test_name_and_version_of_a_distribution(tmp_path, folder, headers, name):
    others = "# by hand\n[console_scripts]\nsoft = soft:main\n"
    entries = f"{others}\n[palpate]\n# one\nsoft = soft_lab.parts [extra]\nhard=hard:offers\n"
    write(tmp_path, folder, entries, headers)
    assert names(tmp_path) == [(f"{name} (hard)", "hard:offers"), (f"{name} (soft)", "soft_lab.parts")]


def test_the_first_on_the_import_path_is_the_installed_one(tmp_path):
    for version, folder in (("1.0", "a"), ("2.0", "b")):
        write(tmp_path / folder, f"soft_lab-{version}.dist-info", "[palpate]\nsoft = soft\n")
    places = [tmp_path / "nowhere", tmp_path / "b", tmp_path / "a"]
    assert names(*places) == [("soft_lab 2.0 (soft)", "soft")]


def test_a_module_or_an_object_of_it_is_loaded(tmp_path):
    write(tmp_path, "m-1.dist-info", "[palpate]\na = math\nb = math:floor.__name__\nc = math:nothing\n")
    module, text, missing = installed_plugins((str(tmp_path),))
    assert module.load().pi == pytest.approx(3.14159, abs=1e-5)
    assert text.load() == "floor"
    with pytest.raises(AttributeError, match="nothing"):
        missing.load()
