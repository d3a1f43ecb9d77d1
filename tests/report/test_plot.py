"""`palpate plot` and the style that all pictures have."""

import csv
import struct

import numpy as np
import pytest
from palpate_kit.figures import common_limits, figure_of, quartiles, save_figure, style

PICTURES = ("force-depth", "time", "residuals", "estimates", "innovations")


@pytest.mark.slow
def test_every_picture_with_its_numbers(palpate, point, tmp_path):
    done = palpate("plot", point, "--out", tmp_path, "--format", "svg")
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} == {
        f"{name}.{ending}" for name in PICTURES for ending in ("svg", "csv")
    }


@pytest.mark.slow
def test_every_format_in_a_column_s_width_is_the_same_file_again(palpate, point, tmp_path):
    formats = ["--format", "png", "--format", "svg", "--format", "pdf"]
    for folder, width in (("a", "120"), ("b", "middle")):
        done = palpate("plot", point, "time", "--out", tmp_path / folder, "--width", width, *formats)
        assert done.returncode == 0, done.stderr
    for ending in ("png", "svg", "pdf", "csv"):
        one, other = ((tmp_path / folder / f"time.{ending}").read_bytes() for folder in "ab")
        assert one == other, ending
    wide = struct.unpack(">I", (tmp_path / "a" / "time.png").read_bytes()[16:20])[0]
    assert wide == int(120 / 25.4 * 200)


@pytest.mark.slow
def test_the_numbers_are_those_of_the_run(palpate, point, tmp_path):
    palpate("plot", point, "force-depth", "--out", tmp_path, "--track", "dr/kinematic")
    with (tmp_path / "force-depth.csv").open() as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    left = np.array([row["force_N"] - row["dr/kinematic:force_N"] for row in rows])
    depth = np.array([row["depth_m"] for row in rows])
    assert 0.03 < left.std() < 0.06  # the noise of the simulated sensor
    assert abs(left.mean()) < 0.01
    assert np.allclose([depth.min(), depth.max()], [3.3e-3, 5.3e-3], atol=4e-4)  # 4 mm +- 1 mm, the skin at 0.3 mm


@pytest.mark.slow
def test_a_map_of_a_sweep(palpate, runs, tmp_path):
    run = runs("sweep", 'run.tracks=["dr/ekf"]')
    done = palpate("plot", run, "map", "--out", tmp_path, "--format", "svg")
    assert done.returncode == 0, done.stderr
    with (tmp_path / "map.csv").open() as file:
        along = [float(row["dr/ekf:along_m"]) for row in csv.DictReader(file)]
    assert np.ptp(along) == pytest.approx(0.07, rel=0.03)
    assert np.all(np.diff(along) > -1e-4)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["force-dept"], "did you mean 'force-depth'"),
        (["map"], "it is of one place"),
        (["--format", "jpg"], "allowed is png, svg, pdf"),
        (["--width", "90"], "allowed is 85, 120, 175"),
        (["--track", "dr/kinematics"], "did you mean 'dr/kinematic'"),
    ],
)
def test_a_mistake_is_one_message(palpate, point, arguments, words):
    done = palpate("plot", point, *arguments)
    assert done.returncode == 2
    assert words in done.stderr


def test_limits_are_not_those_of_a_spike_or_of_what_diverged():
    calm = 100 + np.sin(np.linspace(0, 20, 200))
    spike = np.concatenate([[1e9], calm])
    low, high = common_limits([calm, spike, np.full(200, 1e6), np.full(200, np.nan)])
    assert 90 < low < 99
    assert 101 < high < 110
    assert common_limits([np.full(3, np.nan)]) is None


def test_quartiles_hold_half_of_the_points():
    rng = np.random.default_rng(1)
    x, y = rng.uniform(size=20_000), rng.normal(size=20_000)
    middles, (low, middle, high) = quartiles(x, y, 20)
    assert len(middles) == 20
    assert np.allclose([low, middle, high], [[-0.674], [0], [0.674]], atol=0.2)
    assert quartiles(np.full(3, np.nan), np.ones(3))[0].shape == (0,)


@pytest.mark.slow
def test_names_are_no_formulas_and_pictures_no_accident(tmp_path):
    def draw(path):
        with style():
            figure, axes = figure_of(width=85.0)
            axes[0, 0].plot([0, 1], [0, 1], label="$\\frac{<b>")
            axes[0, 0].legend()
            save_figure(figure, path)
        return path.read_bytes()

    for ending in ("png", "svg", "pdf"):
        assert draw(tmp_path / f"a.{ending}") == draw(tmp_path / f"b.{ending}")
