"""A stage beside what a beam yields by: never the position, and asked about unless the depth is there."""

import numpy as np
import pytest
from palpate import LogError
from palpate_logs.csv_roles import suggest_csv

STAGE, BEAM, DEPTH, FORCE = "stage (mm)", "beam deflection (mm)", "indentation (mm)", "force (N)"


def table(path, *names):
    """A press of a soft half-space by a beam of 0.4 N/mm."""
    depth = np.concatenate([np.zeros(100), np.linspace(0.0, 1.5, 300)])
    noise = np.random.default_rng(0).standard_normal((2, 400))
    force = 0.3 * (depth / 1.5) ** 1.5 + 2e-3 * noise[0]
    columns = {STAGE: depth + force / 0.4, BEAM: force / 0.4, DEPTH: depth + 1e-3 * noise[1], FORCE: force}
    rows = zip(0.01 * np.arange(400), *(columns[name] for name in names))
    path.write_text(
        ",".join(["time (s)", *names]) + "\n" + "".join(",".join(f"{x:.5f}" for x in row) + "\n" for row in rows)
    )
    return path


def test_a_stage_beside_a_deflection_is_asked_about(tmp_path):
    """The stage was taken for the tip: 25 for 60 kPa."""
    path = table(tmp_path / "beam.csv", STAGE, BEAM, FORCE)
    with pytest.raises(LogError, match=r"one constant times beam deflection.*--position 'stage \(mm\)'"):
        suggest_csv(path, {})
    assert suggest_csv(path, {"position": STAGE}).device["columns"]["position"]["column"] == STAGE


def test_a_depth_beside_both_is_the_position(tmp_path):
    found = suggest_csv(table(tmp_path / "depth.csv", STAGE, BEAM, DEPTH, FORCE), {})
    assert found.device["columns"]["position"]["column"] == DEPTH


def test_one_length_alone_is_the_position_however_linear(tmp_path):
    """A cylinder's force is proportional to its depth."""
    found = suggest_csv(table(tmp_path / "flat.csv", BEAM, FORCE), {})
    assert found.device["columns"]["position"]["column"] == BEAM
