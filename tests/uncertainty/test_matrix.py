"""Every kind of model with every kind of estimator on one record: no wrong number without a flag."""

import importlib.util
import re
from pathlib import Path

import pytest

from tests.results import all_codes

_PATH = Path(__file__).parents[2] / "benchmarks" / "matrix.py"
_specification = importlib.util.spec_from_file_location("matrix", _PATH)
benchmark = importlib.util.module_from_spec(_specification)
_specification.loader.exec_module(benchmark)

# A third of the 84 of benchmarks/matrix.py: every model, and every estimator but filterpy's slow ones.
TRACKS = [
    *("dr/ekf", "dr/ukf", "dr/afukf", "dr/kinematic", "dr/smoother", "dr/fit", "dr/filterpy-enkf"),
    *("hc/ekf", "hc/afekf", "hc/kinematic", "hc/fit"),
    *("hcf/ekf", "hcf/afekf", "hcf/kinematic", "hcf/smoother", "hcf/fit"),
    *("kv/ekf", "kv/kinematic", "kv/smoother", "kv/fit"),
    *("maxwell/kinematic", "maxwell/smoother"),
    *("sls/ekf", "sls/kinematic", "sls/smoother"),
    *("drm/kinematic", "drm/smoother"),
]


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """The tracks on one record of 5 s, three times as fast as the paper's 10 s."""
    return benchmark.matrix(1, tmp_path_factory.mktemp("matrix") / "out", TRACKS, "5 s")


@pytest.mark.slow
def test_nothing_is_wrong_without_a_flag(result):
    """Some 20 s, with its fixture, for 27 tracks of one record: each kind of model meets each kind of estimator."""
    assert len(result.tracks) == len(TRACKS)
    assert benchmark.nonsense(result) == []


@pytest.mark.slow
def test_what_is_right_is_not_flagged(result):
    for name in ("dr/kinematic", "dr/smoother", "dr/fit"):
        assert result.tracks[name].verdict in ("good", "note"), result.tracks[name].flags


@pytest.mark.slow
def test_the_reason_is_told(result):
    codes = {name: all_codes(track) for name, track in result.tracks.items()}
    assert {"elsewhere", "overconfident"} & codes["dr/filterpy-enkf"]
    assert "overconfident" in codes["sls/kinematic"] & codes["sls/smoother"]
    assert "inconsistent" in codes["maxwell/smoother"]
    track = result.tracks["sls/kinematic"]
    signs = [sign for flag in (*track.flags, *track.immaterial) for sign in flag.evidence]
    message = next(str(sign) for sign in signs if sign.code == "overconfident")
    assert re.search("hard to distinguish: .*elasticity and (relaxation_time|surface)", message)
    failed = [str(flag) for track in result.tracks.values() for flag in track.flags if flag.code == "diagnosis-failed"]
    assert failed == []
