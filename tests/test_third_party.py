"""A stranger's distribution, installed and used as an outsider would."""

import json
import os
import subprocess
import sys

import pytest

# A distribution that was written for the release before.
pytestmark = pytest.mark.filterwarnings("ignore:import from palpate_engine instead of palpate.host:DeprecationWarning")


@pytest.fixture(scope="module")
def installed(tmp_path_factory, root):
    """A folder on the import path into which pip has installed the distributions."""
    target = tmp_path_factory.mktemp("site")
    strangers = [root / "tests" / "third_party" / name for name in ("palpate-punch", "palpate-histogram")]
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
    environment = {**os.environ, "PIP_DISABLE_PIP_VERSION_CHECK": "1", "PIP_ROOT_USER_ACTION": "ignore"}
    subprocess.run([*command, "--target", target, *strangers], check=True, env=environment, timeout=120)
    return target


@pytest.mark.slow
def test_its_parts_are_listed_with_their_origin(palpate, installed):
    listed = palpate("list", PYTHONPATH=str(installed)).stdout
    assert "pencil" in listed
    assert "recursive-least-squares" in listed
    assert "palpate-punch 1.0 (punch)" in listed


@pytest.mark.slow
def test_its_parts_are_described(palpate, installed):
    described = palpate("describe", "pencil", PYTHONPATH=str(installed)).stdout
    assert "A cone: a(d) = 2 d/(pi tan t)" in described
    assert "slope: angle, must be given" in described


@pytest.mark.gate
@pytest.mark.slow
def test_its_tip_and_its_filter_run_beside_ours(palpate, installed, point_pipeline, tmp_path):
    done = palpate(
        "run",
        point_pipeline,
        "--out",
        tmp_path / "out",
        "--set",
        'indenter.tip={type = "pencil", slope = "30 deg"}',
        "--set",
        'estimator.rls={type = "recursive-least-squares", surface = "0.3 mm"}',
        PYTHONPATH=str(installed),
    )
    assert done.returncode == 0, done.stderr
    tracks = json.loads((tmp_path / "out" / "result.json").read_text())["tracks"]
    assert tracks["dr/rls"]["parameters"]["elasticity"]["value"] == pytest.approx(112.5e3, rel=0.01)
    assert tracks["dr/ekf"]["parameters"]["elasticity"]["value"] == pytest.approx(112.5e3, rel=0.06)


@pytest.mark.slow
def test_its_parts_pass_the_checks(installed):
    script = (
        "import math\n"
        "from palpate_testing import check_estimator, check_indenter\n"
        "from palpate_models import DimensionalityReduction\n"
        "from palpate_punch import Pencil, RecursiveLeastSquares\n"
        "tip = Pencil(slope=math.pi / 6)\n"
        "check_indenter(tip)\n"
        "check_estimator(RecursiveLeastSquares(surface=0.0), DimensionalityReduction(indenter=tip), [1e5, 300.0])\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    subprocess.run([sys.executable, "-c", script], check=True, env=environment, timeout=60)


@pytest.mark.slow
def test_an_analysis_of_a_stranger_stands_beside_ours(palpate, installed, point_pipeline, tmp_path):
    environment = {"PYTHONPATH": str(installed)}
    assert "histogram" in palpate("--help", **environment).stdout
    point_pipeline.write_text(point_pipeline.read_text() + "\n[histogram]\nbins = 1\n")
    short = ["--set", "trajectory.press.duration=6 s", "--set", 'run.tracks=["dr/ekf"]']
    done = palpate("run", point_pipeline, "--out", tmp_path / "out", *short, **environment)
    assert done.returncode == 0, done.stderr
    assert "histogram: 1 tracks to count" in done.stdout
    assert palpate("report", tmp_path / "out", **environment).returncode == 0
    assert "<p>histogram: 1 tracks to count</p>" in (tmp_path / "out" / "report.html").read_text()
    shown = palpate("histogram", tmp_path / "out", **environment)
    assert shown.returncode == 0, shown.stderr
    assert "elasticity of dr/ekf" in shown.stdout
    assert " 1 " in shown.stdout
    wrong = palpate("check", point_pipeline, "--set", "histogram.bins=0", **environment)
    assert wrong.returncode == 2
    assert "[histogram] bins" in wrong.stderr
    unknown = palpate("check", point_pipeline)
    assert unknown.returncode == 2
    assert "[histogram]: unknown table" in unknown.stderr


def test_a_stranger_cannot_take_a_command_of_ours(palpate, tmp_path):
    (tmp_path / "mine.py").write_text(
        "from palpate import Command, plugin\n"
        "@plugin\ndef palpate_commands():\n    return {'run': Command('mine:run', 'My own.')}\n"
    )
    done = palpate("--plugin", tmp_path / "mine.py", "--help")
    assert done.returncode == 2
    assert "command 'run' is claimed by two plugins" in done.stderr


@pytest.mark.slow
def test_two_distributions_that_claim_one_name(palpate, installed, tmp_path):
    rival = tmp_path / "rival"
    rival.mkdir()
    (rival / "rival_tip.py").write_text(
        "from palpate import plugin\nfrom palpate_models import Sphere\n"
        "@plugin\ndef palpate_indenters():\n    return {'pencil': Sphere}\n"
    )
    info = rival / "rival-2.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: rival\nVersion: 2.0\n")
    (info / "entry_points.txt").write_text("[palpate]\nrival = rival_tip\n")
    done = palpate("list", PYTHONPATH=f"{installed}{os.pathsep}{rival}")
    assert done.returncode == 0, done.stderr
    assert "indenter 'pencil' is claimed by palpate-punch 1.0 (punch) and rival 2.0 (rival)" in done.stderr
    assert "palpate-punch:pencil" in done.stdout


@pytest.mark.slow
def test_a_distribution_that_fails_to_import_does_not_stop_the_others(palpate, point_pipeline, tmp_path):
    broken = tmp_path / "broken"
    info = broken / "broken-0.1.dist-info"
    info.mkdir(parents=True)
    (broken / "broken_tip.py").write_text("import nothing_of_the_kind\n")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 0.1\n")
    (info / "entry_points.txt").write_text("[palpate]\nbroken = broken_tip\n")
    environment = {"PYTHONPATH": str(broken)}
    listed = palpate("list", **environment)
    assert listed.returncode == 0
    assert "broken 0.1 (broken) could not be loaded: ModuleNotFoundError" in listed.stderr
    done = palpate(
        "run", point_pipeline, "--out", tmp_path / "out", "--set", "trajectory.press.duration=1 s", **environment
    )
    assert done.returncode == 0
    assert "broken 0.1 (broken) could not be loaded" in done.stderr
    wanted = palpate("check", point_pipeline, "--set", "indenter.tip.type=broken-tip", **environment)
    assert wanted.returncode == 2
    assert "broken 0.1 (broken) could not be loaded: ModuleNotFoundError" in wanted.stderr
