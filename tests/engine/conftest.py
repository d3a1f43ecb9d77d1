"""Live runs of a rig that lives in the test."""

import pytest
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline

from tests.engine import live


@pytest.fixture
def stage(tmp_path):
    """What live rigs and sinks of this test did; a plugin file offers both to pipelines."""
    for heard in (live.LINKS, live.LISTENERS, live.EVENTS):
        heard.clear()
    (tmp_path / "live_parts.py").write_text(
        "from palpate import plugin\nfrom tests.engine import live\n"
        "palpate_devices, palpate_sinks = live.palpate_devices, live.palpate_sinks\n"
    )
    (tmp_path / "live.toml").write_text(live.PIPELINE.format(plugin="live_parts.py"))
    return live


@pytest.fixture
def live_pipeline(stage, tmp_path):
    """A live pipeline with overrides."""
    return lambda *overrides: load_pipeline(tmp_path / "live.toml", overrides)


@pytest.fixture
def run_live(live_pipeline, tmp_path):
    """Run it; a fresh folder each time."""
    count = iter(range(100))

    def run(*overrides, **options):
        return run_pipeline(live_pipeline(*overrides), tmp_path / f"out{next(count)}", **options)

    return run


@pytest.fixture
def kept(stage, point_pipeline, tmp_path):
    """Overrides that give the simulated example a sink that keeps all that it is told."""
    return ['run.plugins=["live_parts.py"]', 'sink.kept.type="kept"']
