"""Runs that the tests of the report share: each is made once."""

from pathlib import Path

import pytest
from palpate_engine import load_pipeline, run_pipeline

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def runs(tmp_path_factory):
    """Make a run of an example once; overrides as of the command line."""
    folder, made = tmp_path_factory.mktemp("runs"), {}

    def make(name, *overrides):
        key = name, overrides
        if key not in made:
            made[key] = folder / f"run-{len(made) + 1}"
            run_pipeline(load_pipeline(ROOT / "pipelines" / f"{name}.toml", list(overrides)), made[key])
        return made[key]

    return make


@pytest.fixture(scope="session")
def point(runs):
    """The example of a point, with both of its tracks."""
    return runs("filters", "trajectory.press.duration=5 s")
