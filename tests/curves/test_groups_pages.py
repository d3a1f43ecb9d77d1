"""Groups of curves on the page of a folder of fits, and their picture."""

import csv

import numpy as np
import pytest

from tests.fit_tables import draw_animals


@pytest.fixture
def fits(tmp_path):
    """Two treatments without any effect, each of five animals of forty curves."""
    return draw_animals(tmp_path / "fits")


@pytest.mark.slow
def test_the_page_compares_units_with_corrected_values(palpate, fits):
    done = palpate("report", "fits", "--by", "treatment")
    assert done.returncode == 0, done.stderr
    page = (fits / "report.html").read_text()
    assert "The means of 10 units (animal) with 400 curves, 5 in each of 2 groups" in page
    assert "5 (animal)" in page
    assert "200 of 200" in page
    assert palpate("report", "fits", "--by", "treatment", "--unit", "site").returncode == 2


@pytest.mark.slow
def test_a_page_of_many_groups_shows_twenty_pairs(palpate, tmp_path):
    draw_animals(tmp_path / "many", groups=12, animals=3, curves=2)
    palpate("report", "many", "--by", "treatment")
    page = (tmp_path / "many" / "report.html").read_text()
    tests = page[page.index("Differences between groups") : page.index("<figure>")]
    assert tests.count("<tr><td>elasticity") == 20
    assert "corrected for 66 pairs by Holm" in tests
    assert "Shown are the 20 smallest p" in tests


@pytest.mark.slow
def test_groups_are_drawn_in_every_format_with_their_numbers(palpate, fits):
    done = palpate("plot", "fits", "--by", "treatment", *[f"--format={ending}" for ending in ("svg", "pdf", "png")])
    assert done.returncode == 0, done.stderr
    assert "over the mean of their group and its 95 % interval" in done.stdout
    for ending, sign in (("svg", b"<svg"), ("pdf", b"%PDF"), ("png", b"PNG")):
        assert sign in (fits / "pictures" / f"elasticity-groups.{ending}").read_bytes()[:1000]
    with (fits / "pictures" / "elasticity-groups.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 10
    assert [row["animal"] for row in rows[:5]] == [f"0-{i}" for i in range(5)]
    first = [float(row["elasticity [Pa]"]) for row in rows[:5]]
    assert float(rows[0]["mean of group [Pa]"]) == pytest.approx(np.mean(first))
    assert float(rows[0]["low of 95 % [Pa]"]) < np.mean(first) < float(rows[0]["high of 95 % [Pa]"])


@pytest.mark.slow
def test_a_picture_of_groups_has_no_colour(palpate, fits):
    from matplotlib.image import imread

    palpate("plot", "fits", "--by", "treatment", "--format", "png", "--width", "120")
    colours = imread(fits / "pictures" / "elasticity-groups.png")[..., :3]
    assert np.ptp(colours, axis=2).max() == 0.0
    assert len(np.unique(colours)) > 10


@pytest.mark.slow
def test_the_same_groups_are_the_same_picture(palpate, fits):
    for name in ("one", "two"):
        palpate("plot", "fits", "--by", "treatment", "--format", "svg", "--out", name)
    one, two = ((fits.parent / name / "elasticity-groups.svg").read_bytes() for name in ("one", "two"))
    assert one == two


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--by", "treatmnt"], "did you mean 'treatment'"),
        (["--by", "treatment", "--parameter", "elastcity"], "did you mean 'elasticity'"),
        (["--by", "treatment", "--track", "dr/ekf"], "--track dr/ekf"),
        (["--by", "treatment", "--unit", "site"], "lies in several groups"),
        (["force-depth", "--by", "treatment"], "its groups are drawn"),
        (["--by", "treatment", "--format", "gif"], "--format gif"),
        (["--by", "treatment", "--where", "treatment=t9"], "no curve has a value"),
    ],
)
def test_a_picture_of_groups_that_cannot_be_is_refused(palpate, fits, words, message):
    done = palpate("plot", "fits", *words)
    assert done.returncode == 2
    assert message in " ".join(done.stderr.split())
    assert not (fits / "pictures").exists()


def test_groups_are_of_folders_of_fits(palpate, tmp_path):
    (tmp_path / "run").mkdir()
    done = palpate("plot", "run", "--by", "treatment")
    assert done.returncode == 2
    assert "--by treatment: run is not a folder of fits" in done.stderr
