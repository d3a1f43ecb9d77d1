"""The verdict on records whose truth is known: what is to be trusted is within twice its uncertainty."""

import json

import pytest
from palpate_engine import is_open
from palpate_report.run_contents import RunContents
from palpate_report.run_verdict import LEVELS, judge

TRUST, LOOK, REFUSE = LEVELS
OPEN = "not determined"
ONE = 'run.tracks=["dr/kinematic"]'
SHORT = "trajectory.press.duration=6 s"

CASES = {
    "as it should be": ("filters", (ONE, SHORT), TRUST),
    "twice the noise": ("filters", (ONE, SHORT, "device.rig.force_std=0.1 N"), TRUST),
    "stiff": ("filters", (ONE, SHORT, "device.rig.specimen.elasticity=400 kPa", "trajectory.press.bias=2 mm"), TRUST),
    "surface elsewhere": ("filters", (ONE, SHORT, "device.rig.specimen.surface=-1 mm"), TRUST),
    "seed 9": ("filters", (ONE, SHORT, "run.seed=9"), TRUST),
    "too short": ("filters", ('run.tracks=["dr/ekf"]', "trajectory.press.duration=1 s"), OPEN),
    "timing nobody declares": ("late", (ONE,), TRUST),  # of elasticity; the viscosity needs the delay
    "a model without the material's memory": ("relaxation", ('run.tracks=["half-space/ekf"]',), LOOK),
    "a filter that expects one material, on a sweep": ("sweep", ('run.tracks=["dr/ekf"]',), LOOK),
    "nothing touched": ("filters", (ONE, SHORT, "device.rig.specimen.surface=-30 mm"), REFUSE),
}


SLOW = ("a model without the material's memory", "a filter that expects one material, on a sweep")


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=[pytest.mark.slow] if case in SLOW else []) for case in CASES]
)
def test_what_is_to_be_trusted_is_right(runs, case):
    name, overrides, expected = CASES[case]
    record = RunContents.read(runs(name, *overrides))
    verdict = judge(record)
    assert verdict.level == expected, verdict
    assert expected in (TRUST, OPEN) or all(track.reasons for track in verdict.tracks)
    for track in verdict.of(TRUST):
        found = record.document["tracks"][track.track]["parameters"]
        for parameter, value in found.items():
            if value["value"] is not None and not is_open(value["verdict"]):
                assert abs(value["value"] - record.document["truth"][parameter]) < 2 * value["combined"], (
                    case,
                    parameter,
                )


@pytest.fixture
def result(point, tmp_path):
    """Write a changed result into a folder of its own and judge it."""
    document = json.loads((point / "result.json").read_text())

    def judged(change):
        change(document)
        (tmp_path / "result.json").write_text(json.dumps(document))
        return judge(RunContents.read(tmp_path))

    return judged


def test_other_models_may_differ(result):
    def change(document):
        good = document["tracks"]["dr/kinematic"]
        other = json.loads(json.dumps(good)) | {"model": "layer"}
        other["parameters"]["elasticity"]["value"] *= 2
        document["tracks"] = {"dr/a": good, "layer/a": other}

    assert result(change).level == TRUST
    assert len(result(lambda _: None).of(TRUST)) == 2
