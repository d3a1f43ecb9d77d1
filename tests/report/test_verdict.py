"""The verdict on records whose truth is known: what is to be trusted is within twice its uncertainty."""

import html
import json
import re

import pytest
from palpate_report.run_contents import RunContents
from palpate_report.run_report import page_of
from palpate_report.run_verdict import LEVELS, judge

from tests import result_documents

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
            if value["value"] is not None and value["verdict"] == "good":
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


DOUBT = {"code": "not-converged", "message": "still moving; can move elasticity by 9 %", "severity": "doubtful",
         "effects": {"elasticity": 9e3}, "moves": ["elasticity"], "remedy": "Palpate for longer."}  # fmt: skip
REHEARSAL = {"code": "rehearsal", "message": "simulated time", "severity": "note"}


def page_with(tmp_path, tracks):
    """The text of the page of a run with these tracks."""
    (tmp_path / "result.json").write_text(json.dumps(result_documents.result(tracks)))
    page = page_of(RunContents.read(tmp_path))
    body = re.sub(r"<(script|style|svg).*?</\1>", " ", page, flags=re.S)
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", body)).split())


def test_a_page_of_several_tracks_has_counts_and_no_headline_of_one(tmp_path):
    """The words "Good: trust it" stood above the number of one track, where 8 of 12 were doubtful."""
    doubted = {"elasticity": result_documents.value(1e5, std=2e3, verdict="doubtful")}
    tracks = {
        "dr/fit": result_documents.track(parameters={"elasticity": doubted["elasticity"] | {"verdict": "good"}}),
        "dr/ekf": result_documents.track("doubtful", [DOUBT], parameters=doubted),
    }
    text = page_with(tmp_path, tracks)
    assert "2 tracks. E: 1 good, 1 doubtful doubtful[not-converged] E, dr/ekf: still moving" in text
    assert "elasticity 100.0 ± 2.0 kPa doubtful" in text
    assert "By dr/fit" not in text
    assert "simulated" not in text


def test_a_page_of_one_track_begins_with_its_value_and_that_of_a_rehearsal_with_the_word_simulated(tmp_path):
    value = result_documents.value(1e5, std=2e3, verdict="good")
    text = page_with(tmp_path, {"dr/fit": result_documents.track(flags=[REHEARSAL], parameters={"elasticity": value})})
    assert text.index("simulated: a rehearsal, of no real specimen") < text.index("E 100.0 ± 2.0 kPa good")
