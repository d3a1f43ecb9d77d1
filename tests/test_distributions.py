"""What wheel and sdist contain."""

import email
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
NAME = f"palpate-{PROJECT['project']['version']}"
FOLDERS = {"benchmarks", "core", "distributions", "docs", "pipelines", "plugins", "tests"}

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The folder of a wheel and an sdist of this checkout."""
    folder = tmp_path_factory.mktemp("dist")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-d", folder], cwd=ROOT, check=True, capture_output=True
    )
    return folder


def files_of(package):
    return {
        path.relative_to(package.parent).as_posix()
        for path in package.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


def test_the_wheel_contains_the_packages_and_nothing_else(built):
    with zipfile.ZipFile(built / f"{NAME}-py3-none-any.whl") as wheel:
        names = {name for name in wheel.namelist() if not name.startswith(f"{NAME}.dist-info/")}
        metadata = email.message_from_bytes(wheel.read(f"{NAME}.dist-info/METADATA"))
    packages = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    assert names == set().union(*(files_of(ROOT / package) for package in packages))
    assert metadata["Version"] == PROJECT["project"]["version"]
    assert metadata.get_payload().startswith("# palpate\n")


def test_the_sdist_contains_what_builds_and_tests_it(built):
    with tarfile.open(built / f"{NAME}.tar.gz") as sdist:
        names = {name.removeprefix(f"{NAME}/") for name in sdist.getnames()}
    folders = {name.partition("/")[0] for name in names if "/" in name and not name.startswith(".")}
    assert folders == FOLDERS
    assert {"CHANGELOG.md", "CITATION.cff", "LICENSE", "README.md", "pyproject.toml"} <= names
    made = [name for name in names if "__pycache__" in name or name.startswith(("docs/reference/", ".venv/", "runs/"))]
    assert not made
