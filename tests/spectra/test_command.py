"""`palpate fit spectrum` as a user calls it."""

import csv
import json

import pytest

SHORT = ["trajectory.press.duration=3 s", 'run.tracks=["dr/kinematic"]']


@pytest.fixture(scope="module")
def run(tmp_path_factory, root):
    from palpate_engine.config import load_pipeline
    from palpate_engine.pipeline import run_pipeline

    folder = tmp_path_factory.mktemp("spectrum") / "run"
    run_pipeline(load_pipeline(root / "pipelines" / "filters.toml", SHORT), folder)
    return folder


@pytest.mark.gate
@pytest.mark.slow
def test_a_run_folder_becomes_a_table_a_csv_and_a_picture(palpate, run, tmp_path):
    done = palpate("fit", "spectrum", run, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "One frequency cannot distinguish a delay from a loss" in done.stdout
    with (tmp_path / "out" / "spectrum.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert float(row["frequency_Hz"]) == pytest.approx(2.0, abs=0.01)
    assert abs(float(row["E_storage_Pa"]) - 112.5e3) < 3 * float(row["E_storage_std_Pa"])
    assert abs(float(row["G_loss_Pa"]) - 12.566 * 362) < 3 * float(row["G_loss_std_Pa"])
    assert (tmp_path / "out" / "spectrum.png").stat().st_size > 5000


@pytest.mark.slow
def test_json_holds_everything_and_two_recordings_are_one_spectrum(palpate, run, tmp_path):
    done = palpate("fit", "spectrum", run, run, "--surface", "0.3 mm", "--json", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert len(found["lines"]) == 2
    assert {"radius", "poisson", "timing", "mass"} <= set(found["lines"][0]["shifts"])
    assert "surface" not in found["lines"][0]["shifts"]  # it was given
    assert found["flags"] == []


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere"], "nowhere"),
        (["{run}", "--track", "dr/kinmatic"], "dr/kinematic"),
        (["{run}", "--frequencies", "2 N"], "--frequencies"),
        (["{run}", "--surface", "abc"], "--surface"),
    ],
)
def test_mistakes_are_one_clear_message(palpate, run, tmp_path, arguments, said):
    done = palpate(
        "fit", "spectrum", *(text.replace("{run}", str(run)) for text in arguments), "--out", tmp_path / "out"
    )
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_authors_soft_silicone(palpate, authors_log, tmp_path):
    """d10mm_soft with its motion 22 ms late: E near the paper's, and one frequency says nothing of a delay."""
    log = authors_log("d10mm_soft")
    pipeline = """
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
[estimator.fit]
type = "casadi-fit"
"""
    (tmp_path / "log.toml").write_text(log + pipeline)
    done = palpate("fit", "spectrum", tmp_path / "log.toml", "--out", tmp_path / "out", "--json")
    assert done.returncode == 0, done.stderr
    (line,) = [one for one in json.loads(done.stdout)["lines"] if one["amplitude_m"] > 5e-4]
    assert line["frequency_Hz"] == pytest.approx(2.0, abs=0.05)
    assert line["E_storage_Pa"] == pytest.approx(126e3, rel=0.05)
    assert line["G_loss_Pa"] / (12.566 * 350) == pytest.approx(1.0, abs=0.2)


def test_a_thick_specimen_is_the_same_said_or_not(tmp_path):
    import numpy as np
    from palpate_models import DimensionalityReduction, Poroelastic, Sphere
    from palpate_spectra.reduced_area import reduced_area

    tip, depth = Sphere(radius="5 mm"), np.linspace(0.0, 3e-3, 7)
    said = DimensionalityReduction(indenter=tip, thickness="half-space")
    np.testing.assert_array_equal(reduced_area(said, depth), reduced_area(DimensionalityReduction(indenter=tip), depth))
    assert Poroelastic(indenter=tip, thickness="half-space").thickness == "half-space"
