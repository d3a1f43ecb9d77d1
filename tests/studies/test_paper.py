"""From forty files to a paper and its archive, by commands; verified where nothing but the archive is.

Forty curves take some 20 s: the counts of a study, of a screen and of workers are those of a laboratory, and small ones
hide what happens above 32 curves.
"""

import shutil

import numpy as np
import pytest

from tests.command import call
from tests.curves.conftest import press

pytestmark = pytest.mark.slow
FACTS = """
instrument = "a press"
tip = "paraboloid 3 mm"
thickness = "half-space"
delay = "0 ms +- 1 ms"
tip_mass = "0 g"
tare = "none"
poisson = 0.5
"""
NAMES = [f"{group}/{animal}{i}.csv" for group in ("control", "treated") for animal in "abcd" for i in range(5)]


@pytest.fixture(scope="module")
def paper(tmp_path_factory):
    """Everything of a paper, made by its commands."""
    folder = tmp_path_factory.mktemp("paper")
    random = np.random.default_rng(3)
    for group, mean in (("control", 1e5), ("treated", 1.4e5)):
        (folder / group).mkdir()
        for animal in "abcd":
            of_animal = mean * (1 + 0.1 * random.standard_normal())
            for i in range(5):
                table = press(int(random.integers(1 << 31)), of_animal * (1 + 0.03 * random.standard_normal()), n=200)
                np.savetxt(folder / group / f"{animal}{i}.csv", table, delimiter=",", fmt="%.9g",
                           header="time_s,force_N,height_mm", comments="")  # fmt: skip
    (folder / "rig.toml").write_text(FACTS)
    lines = [f"{name},{name.split('/')[0]},{name[:9]}" for name in NAMES]
    (folder / "animals.csv").write_text("\n".join(["curve,treatment,animal", *lines]) + "\n")
    for words in (
        "fit control treated --rig rig.toml --out fits",
        "fit fits --groups animals.csv --no-refit",
        "repeat review fits --reject control/a2.csv --reason slipped",
        "repeat fits --by treatment",
        "plot fits --by treatment --format svg --format pdf --format png",
        "report fits --by treatment",
        "report fits --by treatment --methods",
        "report fits --supplement fits/supplement.csv",
        "report fits --supplement fits/supplement.xlsx",
        "pack fits -o study.zip --by treatment",
    ):
        done = call(*words.split(), cwd=folder)
        assert done.returncode == 0, f"{words}: {done.stderr}"
    return folder


def test_forty_files_become_a_paper(paper):
    made = {path.relative_to(paper / "fits").as_posix() for path in (paper / "fits").rglob("*") if path.is_file()}
    assert {
        "report.html", "methods.txt", "methods.tex", "methods.bib", "supplement.csv", "supplement.xlsx",
        *(f"pictures/elasticity-groups.{ending}" for ending in ("svg", "pdf", "png", "csv")),
    } <= made  # fmt: skip
    text = (paper / "fits" / "methods.txt").read_text()
    assert "A total of 40 force-depth curves were recorded with a press." in text
    assert (
        "The means of 8 units (animal) with 39 curves, 4 in each of 2 groups, were compared by Welch's t-test" in text
    )


def test_a_reader_verifies_it_where_nothing_else_is(paper, tmp_path):
    shutil.copy(paper / "study.zip", tmp_path / "study.zip")
    paper.rename(paper.with_name("gone"))
    try:
        done = call("verify", "study.zip", cwd=tmp_path)
    finally:
        paper.with_name("gone").rename(paper)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "40 curves" in done.stdout
    assert "same to the byte: fits.csv, report.html, methods.txt" in done.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["study.zip"]
