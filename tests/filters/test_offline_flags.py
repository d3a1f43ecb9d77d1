"""Offline tracks are judged by the innovations of their forward pass; what was held fixed is not judged at all."""

import pytest
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline

from tests.results import all_codes

INNOVATIONS = {"inconsistent", "coloured-innovations"}


@pytest.fixture
def judged(point_pipeline, tmp_path):
    """Flags of the one offline track with some settings."""

    def run(settings, *overrides):
        table = ", ".join(f"{key} = {value}" for key, value in settings.items())
        chosen = ['run.tracks=["*/offline"]', f"estimator.offline={{{table}}}", *overrides]
        result = run_pipeline(
            load_pipeline(point_pipeline, ["trajectory.press.duration=5 s", *chosen]), tmp_path / "out"
        )
        (track,) = result.tracks.values()
        return track, all_codes(track)

    return run


def test_a_smoother_with_the_right_noise_has_no_flag_of_its_innovations(judged):
    track, codes = judged({"type": '"kinematic-smoother"'})
    assert not INNOVATIONS & codes
    assert track.parameters["elasticity"].value == pytest.approx(112.5e3, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [{"force_std": '"0.01 N"'}, {"start_from": '"guess"'}])
def test_a_smoother_whose_forward_pass_disagrees_says_so(judged, wrong):
    """Too small a noise; and a start that ends far off (E of some MPa for 0.1125 at a NIS of thousands)."""
    _, codes = judged({"type": '"kinematic-smoother"', **wrong})
    assert "inconsistent" in codes


def test_what_is_held_fixed_is_neither_implausible_nor_late(judged):
    """A viscosity held at 0, the edge of what is possible; timing shifts what is estimated only."""
    settings = {"type": '"casadi-fit"', "fixed": "{ viscosity = 0.0 }"}
    track, codes = judged(settings, "device.rig.specimen.viscosity=0 Pa*s")
    assert track.parameters["viscosity"].value == 0.0
    assert not {"implausible", "not-distinguishable-from-delay", "timing-undeclared"} & codes
