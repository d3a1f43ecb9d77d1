"""Repeated lines and rasters: the same body agrees, another one does not."""

from dataclasses import replace

import numpy as np
import pytest
from palpate import LogError
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_maps.map_agreement import map_agreement
from palpate_maps.map_analysis import Sites, read_path, sites_along
from palpate_maps.rig_share import fact_differences, rig_share
from scipy import stats

STATED = 0.01  # of a site


def raster(seed, shift=0.0, contrast=0.3, level=0.0, scatter=0.4, x_from=-30, x_to=30):
    """Sites of seven lines 5 mm apart over a lump 10 mm wide; their errors are alike over 4 mm, and 0.4 of stated."""
    dice = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(x_from, x_to + 1) * 1e-3, np.arange(-15, 16, 5) * 1e-3)
    x[1::2] = x[1::2, ::-1]
    place = np.column_stack([x.ravel(), y.ravel()])
    bump = contrast * np.exp(-((place[:, 0] - shift) ** 2 + place[:, 1] ** 2) / (2 * 4.2e-3**2))
    n = len(place)
    noise = np.convolve(dice.standard_normal(n + 3), np.ones(4) / 2, "valid")
    log = np.log(1e5) + level + np.log1p(bump) + scatter * STATED * noise
    return Sites(place, log, np.full(n, STATED), np.arange(n) / 6.0, np.zeros(n, bool))


def line(sites):
    """The middle line of a raster."""
    return sites[np.abs(sites.place[:, 1]) < 1e-4]


def long_line(seed):
    """A line of 120 mm over the lump."""
    return line(raster(seed, x_from=-60, x_to=60))


def test_repeats_of_one_body_agree_and_scatter_by_what_they_do():
    p, scatter = zip(
        *(
            (found.p, found.repeatability)
            for k in range(20)
            if (found := map_agreement(long_line(k), long_line(100 + k)))
        ),
        strict=True,
    )
    assert stats.kstest(p, "uniform").pvalue > 0.01
    assert np.median(scatter) == pytest.approx(0.4 * 0.83, rel=0.25)  # means of 4 sites whose errors are alike


@pytest.mark.parametrize("other", [{"shift": 3e-3}, {"contrast": 0.36}, {"level": np.log(1.2)}])
def test_another_body_does_not_agree(other):
    found = map_agreement(raster(1), raster(2, **other))
    assert found.p < 5e-3
    assert np.abs(found.e_n).max() > 1
    if "level" in other:
        assert found.pattern_p > 0.01
        assert found.level[0] == pytest.approx(np.log(1.2), abs=5e-3)


def test_a_line_is_compared_as_a_raster_is():
    assert map_agreement(line(raster(1)), line(raster(2))).p > 0.01
    assert map_agreement(line(raster(1)), line(raster(2, shift=5e-3))).p < 0.01


def test_a_difference_within_the_facts_of_the_rig_is_none():
    """10 % where the facts leave 8 % open."""
    assert map_agreement(raster(1), raster(2, level=0.1)).p < 5e-3
    found = map_agreement(raster(1), raster(2, level=0.1), common_std=0.08)
    assert found.p > 0.05
    assert np.abs(found.e_n).max() < 1


def test_what_only_one_covers_is_left_out():
    found = map_agreement(raster(1), raster(2, x_from=0, x_to=60))
    assert found.place[:, 0].min() > -3e-3
    assert found.shares == pytest.approx((0.5, 0.5), abs=0.05)
    with pytest.raises(LogError, match="both cover 0 places"):
        map_agreement(raster(1), raster(2, x_from=40, x_to=80))


SMALL = (
    'trajectory.raster.size=["40 mm","20 mm"]',
    "trajectory.raster.speed=6 mm/s",
    "trajectory.raster.settle=1 s",
    "estimator.smoother.sweep_speed=6 mm/s",
    'run.tracks=["dr/smoother"]',
)
BODY = '[{{shape="sphere", place=["{x} mm","0 mm"], depth="4 mm", radius="4 mm", stiffness_ratio={ratio}}}]'


@pytest.fixture(scope="module")
def simulate(root, tmp_path_factory):
    """A run of a small raster over a sphere, of a seed, a place [mm] and a ratio of stiffness."""

    def run(seed, x=0, ratio=3.0, *more):
        body = f"device.rig.specimen.inclusions={BODY.format(x=x, ratio=ratio)}"
        pipeline = load_pipeline(root / "pipelines" / "raster.toml", [f"run.seed={seed}", body, *SMALL, *more])
        folder = tmp_path_factory.mktemp("runs") / f"run-{seed}"
        run_pipeline(replace(pipeline, sinks={}), folder)
        return folder

    return run


def sites_of(folder):
    return sites_along(read_path(folder))


@pytest.mark.slow
def test_simulated_rasters_of_one_body_agree_and_others_do_not(simulate):
    """42 runs, some two minutes: the p-value has to be uniform where rig and filter make the errors."""
    sites = [sites_of(simulate(seed)) for seed in range(100, 140)]
    p = [map_agreement(first, second).p for first, second in zip(sites[::2], sites[1::2], strict=True)]
    assert stats.kstest(p, "uniform").pvalue > 0.01
    for other in (simulate(200, 3), simulate(201, 0, 3.9)):
        assert map_agreement(sites[0], sites_of(other)).p < 0.01


@pytest.mark.slow
def test_the_command_says_by_which_uncertainty(palpate, simulate, tmp_path):
    same, again, heavier = simulate(1), simulate(2), simulate(3, 0, 3.0, "alignment.tip_mass=150 g")
    assert fact_differences(same, again) == ""
    assert "poisson" in rig_share(same, "dr/smoother", "elasticity").causes
    picture = tmp_path / "agree.png"
    done = palpate("map", "agree", same, again, "--out", picture)
    assert done.returncode == 0, done.stderr
    assert "repeatability alone" in done.stdout
    assert "common to all places" in done.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")
    done = palpate("map", "agree", same, heavier, "--out", picture)
    assert "all uncertainty" in done.stdout
    assert "alignment.tip_mass is 0.15, was 0.14" in done.stdout
    assert "of rig and law" in palpate("map", same).stdout


@pytest.mark.slow
def test_a_map_on_a_surface_and_one_in_a_plane_share_no_place(palpate, simulate, tmp_path):
    on_surface = (
        'surface.skin={type="plane"}',
        "alignment.surface=skin",
        "trajectory.raster.surface=skin",
        "device.rig.specimen.body=skin",
        "device.rig.specimen.relief={}",
    )
    flat, lifted = simulate(1), simulate(2, 0, 3.0, *on_surface)
    done = palpate("map", "agree", flat, lifted, "--out", tmp_path / "agree.png")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"palpate: {lifted} lies on a surface and {flat} in a plane: they share no place\n"


def test_one_run_is_not_compared(palpate, tmp_path):
    done = palpate("map", "agree", tmp_path)
    assert done.returncode == 2
    assert "two runs or more are needed" in done.stderr
    done = palpate("map", "agree", tmp_path, tmp_path)
    assert done.returncode == 2
    assert "given twice" in done.stderr
