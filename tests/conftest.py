"""What the tests share: the real command, the example pipelines, the authors' logs."""

import os
import shutil
import sys
import tempfile
from functools import partial
from pathlib import Path

import pytest

from tests import busy

ROOT = Path(__file__).parent.parent
_LIVE = {"bench", "shared_bench", "main_job"}  # fixtures that run a twin in real time
_BESIDE_A_RIG = ("tests/live_page/test_page.py",)  # live, and no arm moves
# Long files come first, lest one be left to the end; then those that share nothing, whose tests go one by one.
_LONG = (
    *("studies/test_cluster.py", "filters/test_conformance.py", "filters/test_export_filter.py"),
    *("uncertainty/test_matrix.py", "maps/test_commands.py", "devices/test_arm_limits.py", "devices/test_ur3e.py"),
    *("devices/test_acceptance.py", "fits/test_fit_command.py", "fits/test_fit.py", "report/test_report.py"),
    *("test_third_party.py", "filters/test_parity.py", "filters/test_kinematic_parity.py", "studies/test_sweep.py"),
    *("devices/test_force_hold.py", "devices/test_bota.py", "devices/test_live.py", "devices/test_hand.py"),
    "starting/test_starting.py",
)
_APART = (
    *("test_walks.py", "test_pipelines.py", "test_plugin_readmes.py", "core/test_small_core.py"),
    *("devices/test_stations.py", "report/test_damaged_runs.py"),
)


def pytest_configure(config):
    """What a test approves is approved for tests; linear algebra has one thread, as on the command line."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ["XDG_STATE_HOME"] = tempfile.mkdtemp(prefix="palpate-state-")
    config.add_cleanup(partial(shutil.rmtree, os.environ["XDG_STATE_HOME"], ignore_errors=True))


def pytest_addoption(pluginmanager):
    """A busy machine fails no live test."""
    pluginmanager.register(busy)


@pytest.hookimpl(wrapper=True)
def pytest_collection(session):
    """What is compiled on the way, all of palpate and the tests, is kept: processes of the tests import it, too.

    Only here, so nothing is imported before, and also with PYTHONDONTWRITEBYTECODE: tests write plugin files anew that
    look like the last ones.
    """
    before, sys.dont_write_bytecode = sys.dont_write_bytecode, False
    try:
        return (yield)
    finally:
        sys.dont_write_bytecode = before


def pytest_collection_modifyitems(items):
    """A job that moves the twins wants the cores to itself, as on a rig; long files come first, lest one be left."""
    for item in items:
        if not item.get_closest_marker("talks") and _LIVE & set(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.live)
    rank = {ROOT / "tests" / name: place for place, name in enumerate((*_LONG, *_APART))}
    items.sort(key=lambda item: rank.get(item.path, len(rank)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Tests of one file share its fixtures in one worker; where rigs move, all of them are one file."""
    if config.getvalue("dist") == "each":
        return None
    from xdist.scheduler import LoadFileScheduling

    class ByFile(LoadFileScheduling):
        def _split_scope(self, nodeid):
            file = nodeid.partition("::")[0]
            if config.option.markexpr == "live" and not file.startswith(_BESIDE_A_RIG):
                return "rig"
            return nodeid if file.endswith(_APART) else file

    config.option.loadscopereorder = False  # the order is that of the collection
    return ByFile(config, log)


@pytest.fixture(scope="session", autouse=True)
def _results_are_what_the_schema_says():
    from tests.results import checked

    with checked():
        yield


@pytest.fixture(scope="session")
def root():
    """The project's folder."""
    return ROOT


@pytest.fixture(scope="session")
def shared():
    """The folder of real logs; tests that need it skip where it is absent."""
    folder = Path(os.environ.get("PALPATE_SHARED", ROOT.parent / "shared")) / "data"
    if not folder.is_dir():
        pytest.skip(f"the real logs are not here: no {folder}")
    return folder


@pytest.fixture
def authors_log(shared):
    """Tables of device, alignment and tip (5 mm where no radius is named) for a point palpation of the authors."""

    def tables(name, radius="5 mm", motion="22 ms", force="0 ms", uncertainty="0.5 ms", tip_mass="140 g"):
        timing = f', uncertainty = "{uncertainty}"' if uncertainty else ""
        mass = f'tip_mass = "{tip_mass}"\n' if tip_mass else ""
        return f"""
[device.log]
type = "csv-replay"
file = "{shared}/ur3e-bota-2024/{name}.csv.gz"
rate = "500 Hz"
columns.z = {{ column = 0, unit = "mm" }}
columns.v = {{ column = 3, unit = "mm/s" }}
columns.fz = {{ column = 4, unit = "N" }}
[alignment]
force = {{ channel = "log.fz", delay = "{force}" }}
position = {{ channel = "log.z", delay = "{motion}"{timing} }}
velocity = {{ channel = "log.v", sign = -1, delay = "{motion}"{timing} }}
tare = "0 N"
tare_uncertainty = "0 N"
{mass}[indenter.tip]
type = "sphere"
radius = "{radius}"
"""

    return tables


@pytest.fixture
def point_pipeline(tmp_path):
    """A copy of the example pipeline in a folder of its own."""
    return Path(shutil.copy(ROOT / "pipelines" / "filters.toml", tmp_path / "point.toml"))


@pytest.fixture
def run_point(point_pipeline, tmp_path):
    """Run the example pipeline with overrides, the paper's filter only; a fresh folder each time."""
    from palpate_engine.config import load_pipeline
    from palpate_engine.pipeline import run_pipeline

    def run(*overrides, name="out"):
        return run_pipeline(load_pipeline(point_pipeline, ['run.tracks=["*/ekf"]', *overrides]), tmp_path / name)

    return run


@pytest.fixture
def palpate(tmp_path):
    """The command line in a folder of its own, called as a function; environment variables are keywords."""
    from tests import command

    return partial(command.call, cwd=tmp_path)


@pytest.fixture
def palpate_process(tmp_path):
    """The command line in a process and a folder of its own: for what only a process shows."""
    from tests import processes

    return partial(processes.palpate, cwd=tmp_path)
