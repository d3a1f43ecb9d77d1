"""The example pipelines: each is in order, and those without hardware run."""

import re
from pathlib import Path

import pytest
from palpate_engine import check_motion, load_pipeline, registry

FOLDER = Path(__file__).parent.parent / "pipelines"
LONG = (
    "breast",
    "points",
    "raster",
    "relaxation",
    "sweep",
    "tips",
    "memory",
    "damping",
    "adhesion",
    "creep",
    "waypoints",
    "unloading",
)
PARTS = sorted(FOLDER.glob("parts/*.toml"))
PIPELINES = [*sorted(FOLDER.glob("*.toml")), *PARTS]
FIGURES = [path for path in sorted(FOLDER.glob("figures/*.toml")) if 'type = "sim"' in path.read_text()]


def test_there_are_some():
    assert PIPELINES


@pytest.mark.parametrize("pipeline", [*PIPELINES, *FIGURES], ids=lambda path: path.stem)
def test_it_is_in_order(palpate, pipeline):
    done = palpate("check", pipeline)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, id=path.stem, marks=[pytest.mark.slow] if path.stem.startswith("breast") else [])
        for path in PIPELINES
        if "[safety]" in path.read_text()
    ],
)
def test_its_motion_keeps_its_limits(path):
    pipeline = load_pipeline(path)
    problems = [check_motion(one, pipeline.safety).problems for one in pipeline.trajectories.values()]
    assert not any(problems)


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


@pytest.mark.parametrize("kind", ["indenter", "model", "trajectory", "estimator"])
def test_every_part_of_an_estimate_is_in_an_example(kind):
    """Whoever looks for a tip, a model, a motion or a filter sees one at work, and what it finds of a known truth."""
    text = "\n".join(path.read_text() for path in FOLDER.rglob("*.toml"))
    named = set(re.findall(r'type = "([^"]+)"', text)) | {"lifted-motion"}  # made by `palpate run --lift`
    shipped = {name for name, entry in registry.load().parts[kind].items() if entry.plugin.own}
    assert shipped - named == set()
