"""Walks of people who have just come: the first pages of the site as they stand, and the README's first run.

The page of the roboticist rehearses a whole raster twice, which takes longer than all others: the site executes it.
"""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
CELL = re.compile(r"^```\{code-cell\}\n(.*?)^```$", re.MULTILINE | re.DOTALL)
OPTION = re.compile(r"^:.*\n", re.MULTILINE)
WALKS = {
    "a student with CSV files": "from-csv",
    "an author of parts": "own-parts",
    "a user of notebooks": "arrays",
    "a referee": "plus-minus",
    "an owner of a rheometer": "rheometer",
}
# Pages show pictures by IPython, which the tests do not need: a picture is read instead.
BEFORE = """
import sys, types
from pathlib import Path
display = types.ModuleType("IPython.display")
display.Image = lambda path, **_: Path(path).read_bytes()
sys.modules["IPython.display"] = display
"""


@pytest.mark.slow
@pytest.mark.parametrize("page", WALKS.values(), ids=WALKS)
def test_a_page_leads_from_its_first_line_to_its_last(page, tmp_path):
    text = (ROOT / "docs" / "tutorials" / f"{page}.md").read_text()
    cells = [OPTION.sub("", cell) for cell in CELL.findall(text)]
    script = tmp_path / "cells.py"
    script.write_text(BEFORE + "\n".join(cells))
    walk = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True)
    assert walk.returncode == 0, walk.stdout + walk.stderr


@pytest.mark.gate
@pytest.mark.slow
def test_the_readme_shows_what_its_first_run_prints(palpate, tmp_path):
    readme = (ROOT / "README.md").read_text()
    (command,) = re.findall(r"\.venv/bin/palpate (run \S+)$", readme, re.MULTILINE)
    (shown,) = re.findall(r"```\n(S2, sphere.*?)```", readme, re.DOTALL)
    what, pipeline = command.split()
    printed = palpate(what, ROOT / pipeline, "--out", tmp_path / "run").stdout
    printed_rows = [line.split() for line in printed.splitlines()]
    for track in ("dr/kinematic", "truth"):
        assert row_of(track, shown.splitlines()) in printed_rows
    assert shown.splitlines()[-1].split() in printed_rows


def row_of(track, lines):
    """The words of a track's row in a table."""
    (row,) = [line.split() for line in lines if f" {track} " in line]
    return row
