"""Walks of people who have just come: the first pages of the site as they stand, and the README's first run.

The page of the roboticist rehearses a whole raster twice, which takes longer than all others: the site executes it.
"""

import csv
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
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
    "an author of a paper": "paper",
    "an owner of two tips": "two-tips",
    "an owner of another arm": "own-robot",
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
    """Over 20 s for some: they are what a reader does, command by command, and no shorter page teaches it."""
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
    (shown,) = re.findall(r"```\n(S2, simulated.*?)```", readme, re.DOTALL)
    what, pipeline = command.split()
    run = tmp_path / "run"
    printed = palpate(what, ROOT / pipeline, "--out", run).stdout
    assert printed.startswith(re.sub(r"runs/\S+", shlex.quote(str(run)), shown))


@pytest.mark.slow
def test_the_readme_leads_from_a_table_to_a_number(palpate, tmp_path):
    """Its third command, on a press of 100 kPa under a sphere of 5 mm."""
    readme = (ROOT / "README.md").read_text()
    (command,) = re.findall(r"\.venv/bin/palpate (fit .+)$", readme, re.MULTILINE)
    what, folder, *options = shlex.split(command)
    time = np.arange(0.0, 8.0, 0.004)
    depth = np.interp(time, [0, 1, 3, 8], [-1e-3, -1e-3, 3e-3, 3e-3]) + 5e-4 * np.sin(4 * np.pi * time) * (time > 3)
    radius = 5e-3  # of a ball: d = (a/2) ln((R + a)/(R - a)) gives its contact radius (Sneddon 1965)
    radii = np.linspace(0.0, 0.99 * radius, 2001)
    logarithm = np.log((radius + radii) / (radius - radii))
    contact = np.interp(np.maximum(depth, 0.0), radii / 2 * logarithm, radii)
    logarithm = np.log((radius + contact) / (radius - contact))
    force = 100e3 / 0.75 * ((contact**2 + radius**2) / 2 * logarithm - contact * radius)
    force += 0.02 * np.random.default_rng(1).standard_normal(len(time))
    rows = np.column_stack([time, force, 1e3 * (20e-3 - depth)])
    (tmp_path / folder).mkdir()
    header = "time (s),force (N),height (mm)"
    np.savetxt(tmp_path / folder / "press.csv", rows, delimiter=",", header=header, comments="", fmt="%.6f")
    done = palpate(what, tmp_path / folder, *options, "--out", tmp_path / "fits")
    (row,) = csv.DictReader((tmp_path / "fits" / "fits.csv").read_text().splitlines())
    value, spread = float(row["elasticity"]), float(row["elasticity_combined"])
    assert abs(value - 100e3) < 2 * spread < 40e3, done.stdout
