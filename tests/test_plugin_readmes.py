"""The code in each plugins/*/README.md runs as it stands."""

import re
from pathlib import Path

import pytest

from tests.processes import PYTEST, run

ROOT = Path(__file__).parent.parent
READMES = sorted((ROOT / "plugins").glob("*/README.md"))
QUICK = ("calibration",)  # most start a run and pytest
BLOCK = re.compile(r"^```(\w+)\n# file: (\S+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def test_every_family_has_one():
    families = {path.name for path in (ROOT / "plugins").iterdir() if path.is_dir()}
    assert families == {path.parent.name for path in READMES}


@pytest.mark.slow
@pytest.mark.parametrize(
    "readme",
    [
        pytest.param(path, id=path.parent.name, marks=[] if path.parent.name in QUICK else [pytest.mark.slow])
        for path in READMES
    ],
)
def test_its_code_runs(readme, palpate, tmp_path):
    blocks = {name: text for _, name, text in BLOCK.findall(readme.read_text())}
    assert blocks
    for name, text in blocks.items():
        (tmp_path / name).write_text(text)
    for name in blocks:
        if name.startswith("test_"):
            done = run(PYTEST, "-q", "-p", "no:cacheprovider", name, cwd=tmp_path, timeout=120)
            assert done.returncode == 0, done.stdout
        if name.endswith(".toml"):
            done = palpate("run", name, "--out", tmp_path / f"out-{name}")
            assert done.returncode == 0, done.stderr
            assert "not loaded" not in done.stderr
