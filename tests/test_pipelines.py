"""The example pipelines: each is in order, and those without hardware run."""

from pathlib import Path

import pytest

FOLDER = Path(__file__).parent.parent / "pipelines"
LONG = ("points", "raster", "relaxation", "sweep")
PIPELINES = sorted(FOLDER.glob("*.toml"))
FIGURES = [path for path in sorted(FOLDER.glob("figures/*.toml")) if 'type = "sim"' in path.read_text()]


def test_there_are_some():
    assert PIPELINES


@pytest.mark.parametrize("pipeline", [*PIPELINES, *FIGURES], ids=lambda path: path.stem)
def test_it_is_in_order(palpate, pipeline):
    done = palpate("check", pipeline)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    "pipeline",
    [
        pytest.param(path, id=path.stem, marks=[pytest.mark.slow] if path.stem in LONG else [])
        for path in PIPELINES
        if 'type = "sim"' in path.read_text()
    ],
)
def test_it_runs(palpate, pipeline, tmp_path):
    done = palpate("run", pipeline, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "result.json").exists()
