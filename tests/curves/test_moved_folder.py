"""A folder of fits handed on with its curves: every path in it is as seen from it."""

import shutil
from pathlib import Path

import pytest
from palpate_kit.curves.curve_pipelines import dialect_pipeline
from palpate_kit.curves.fit_folder import FitFolder

from tests.curves.conftest import NAMES


def test_what_is_moved_together_is_as_fitted_as_before(folder, palpate, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere") / "of a colleague"
    shutil.move(folder, elsewhere)
    folder.mkdir()  # the fixture's, which is empty now
    moved = FitFolder(elsewhere / "fits")
    assert {row.state for row in moved.rows} == {"current"}
    assert sorted(Path(curve.file) for curve in moved.curves()) == sorted(elsewhere / name for name in NAMES)
    assert dialect_pipeline(moved).devices["log"].file.is_file()
    texts = [path.read_text() for path in (elsewhere / "fits").iterdir()]
    assert not [text for text in texts if str(folder.resolve()) in text]


@pytest.mark.slow
def test_a_moved_folder_is_fitted_again_where_it_is(folder, palpate, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere") / "moved"
    shutil.copytree(folder, elsewhere)
    shutil.rmtree(folder / "curves")
    done = palpate("fit", elsewhere / "fits", "--thickness", "half-space", "--where", f"curve={NAMES[0]}")
    assert done.returncode == 0, done.stderr
    assert "1 curve fitted again" in done.stdout


def test_curves_that_have_gone_leave_values_with_their_units(folder, palpate):
    shutil.rmtree(folder / "curves")
    assert FitFolder(folder / "fits").units["elasticity"] == "Pa"
    refused = palpate("fit", "fits", "--where", f"curve={NAMES[0]}", "--thickness", "half-space")
    assert refused.returncode == 2
    assert "no such file" in refused.stderr
