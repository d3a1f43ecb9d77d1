"""Model choice and outliers."""

from dataclasses import replace

import numpy as np
import pytest
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_filters import KinematicFilter
from palpate_fits import CasadiFit
from palpate_uncertainty.model_choice import correlation_time, model_choice, weigh_models
from palpate_uncertainty.outliers import outliers, spikes_of
from palpate_uncertainty.settings import ChoiceSettings

CANDIDATES = """
[indenter.sphere]
type = "exact-sphere"
radius = "RADIUS"
[model.half-space]
type = "dimensionality-reduction"
indenter = "sphere"
[model.layer]
type = "dimensionality-reduction"
indenter = "sphere"
thickness = { law = "dimitriadis", height = "22 mm", bonded = false }
[model.cylinder]
type = "dimensionality-reduction"
indenter = "tip"
thickness = { law = "finite-cylinder", height = "22 mm", diameter = "50 mm", bonded = false }
[estimator.fit]
type = "casadi-fit"
[choice]
candidates = ["half-space", "layer", "cylinder"]
"""


def test_independent_residuals_choose_and_correlated_ones_do_not():
    values, stds, bic = np.array([100.0, 150.0]), np.array([1.0, 1.0]), np.array([0.0, 520.0])
    certain = weigh_models(values, stds, bic, 4988, 4988)
    assert certain.value == pytest.approx(100.0)
    doubtful = weigh_models(values, stds, bic, 6, 4988)
    assert doubtful.weights[1] == pytest.approx(np.exp(-520 * 6 / 4988 / 2) / (1 + np.exp(-520 * 6 / 4988 / 2)))
    for found in (certain, doubtful):
        assert found.spread >= np.std(values, ddof=1)
        assert found.combined > found.spread


def test_the_weights_do_not_depend_on_the_order_or_on_a_shift_of_the_evidence():
    values, stds, bic = np.array([1.0, 2.0, 4.0]), np.full(3, 0.1), np.array([3.0, 0.0, 7.0])
    found, other = weigh_models(values, stds, bic, 50, 100), weigh_models(values[::-1], stds, bic[::-1] + 1e3, 50, 100)
    assert other.value == pytest.approx(found.value)
    np.testing.assert_allclose(other.weights[::-1], found.weights)


@pytest.mark.slow
def test_the_correlation_time_is_that_of_an_autoregression():
    noise = np.random.default_rng(0).standard_normal(100_000)
    assert correlation_time(noise) == pytest.approx(1.0, abs=0.05)
    for i in range(1, len(noise)):
        noise[i] += 0.9 * noise[i - 1]
    assert correlation_time(noise) == pytest.approx(19.0, rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "radius", "motion", "force"),
    [("d10mm_soft", "5 mm", "22 ms", "0 ms"), ("d5mm_soft", "2.5 mm", "0 ms", "12 ms")],
)
def test_the_interval_with_the_geometry_overlaps_the_dynamometer(authors_log, tmp_path, file, radius, motion, force):
    log = authors_log(file, radius, motion, force)
    (tmp_path / "p.toml").write_text(log + CANDIDATES.replace("RADIUS", radius))
    result = run_pipeline(load_pipeline(tmp_path / "p.toml"), tmp_path / "out")
    assert set(result.tracks) == {"half-space/fit", "layer/fit", "cylinder/fit"}
    found = [track.parameters["elasticity"] for track in result.tracks.values()]
    choice = next(iter(result.tracks.values())).diagnoses["model-choice"]
    assert sum(choice["weights"].values()) == pytest.approx(1.0)
    elasticity = choice["elasticity"]
    assert elasticity["spread"] >= np.std([f.value for f in found], ddof=1) * 0.999
    assert abs(elasticity["value"] - 112.5e3) < 2 * elasticity["combined"] + 2 * 6e3
    for one in found:
        assert one.budget["model_choice"] >= 0.999 * elasticity["spread"]
        assert not one.combined < one.budget["model_choice"]
    assert all("model-choice" in {flag.code for flag in track.flags} for track in result.tracks.values())


@pytest.mark.slow
def test_spikes_are_counted_and_a_clean_record_has_none(evidence):
    track = evidence("clean", CasadiFit())
    assert outliers([track]) == {}
    left = track.kept.innovation.copy()
    rows = np.flatnonzero(track.kept.used)[100:4100:500]
    left[rows] += 12.0 / np.sqrt(track.report.rss / track.report.samples)
    spiked = replace(track, kept=replace(track.kept, innovation=left))
    (finding,) = outliers([spiked]).values()
    assert [flag.code for flag in finding.flags] == ["outliers"]
    assert finding.table["count"] == len(rows)
    assert finding.table["largest"] == pytest.approx(12.0, abs=0.5)
    robust = replace(spiked, estimator=KinematicFilter(student=4.0))
    assert not next(iter(outliers([robust]).values())).flags


def test_a_tap_is_no_spike():
    time = np.arange(4000) / 500.0
    contact = np.maximum(np.sin(2 * np.pi * 5 * time), 0.0) ** 1.5 * 20.0  # lifts off in every cycle
    every = np.ones(len(time), bool)
    assert not len(spikes_of(contact + 0.01 * np.random.default_rng(0).standard_normal(len(time)), every))
    assert not len(spikes_of(np.round(contact, 1), every))


@pytest.mark.slow
def test_a_candidate_without_a_result_is_flagged(evidence):
    tracks = [evidence("clean", CasadiFit()), evidence("thickness", CasadiFit())]
    tables = {"choice": ChoiceSettings(candidates=("a", "b", "gone"))}
    tracks = [replace(track, name=f"{name}/fit", tables=tables) for track, name in zip(tracks, "ab", strict=True)]
    found = model_choice(tracks)
    assert [flag.code for flag in found["a/fit"].flags] == ["model-choice", "choice-incomplete"]
    assert "gone" in found["a/fit"].flags[1].message
    assert model_choice([replace(track, tables={}) for track in tracks]) == {}
