"""Diagnoses run after those that they state, and are given the findings of those alone."""

import json

import numpy as np
import pytest
from palpate import Diagnosis, PluginError
from palpate.registry import load
from palpate_engine.result.diagnoses import diagnosis_order


def judge(tracks):
    """No finding."""
    return {}


def named(**after):
    return {name.replace("_", "-"): Diagnosis(judge, after=names) for name, names in after.items()}


def test_each_runs_after_what_it_states_and_is_given_that_alone():
    order = dict(diagnosis_order(named(noise=("budget",), budget=("readings",), other=(), readings=())))
    assert list(order) == ["other", "readings", "budget", "noise"]
    assert order == {"other": [], "readings": [], "budget": ["readings"], "noise": ["readings", "budget"]}


def test_every_other_stands_for_all_that_do_not_state_it():
    every = Diagnosis.EVERY_OTHER
    order = dict(diagnosis_order(named(last=(every, "second"), second=(every,), budget=(), noise=("budget",))))
    assert order["second"] == ["budget", "noise"]
    assert order["last"] == ["budget", "noise", "second"]


def test_a_family_that_is_not_installed_is_not_waited_for():
    assert diagnosis_order(named(noise=("budget",))) == [("noise", [])]


def test_a_circle_is_named():
    with pytest.raises(
        PluginError, match=r"diagnoses wait for each other: 'one', 'other', 'one'|'other', 'one', 'other'"
    ):
        diagnosis_order(named(one=("other",), other=("one",)))


def test_what_the_shipped_ones_state_is_offered():
    diagnoses = load().diagnoses
    stated = {other for diagnosis in diagnoses.values() for other in diagnosis.after}
    assert stated - set(diagnoses) == {Diagnosis.EVERY_OTHER}
    order = dict(diagnosis_order(diagnoses))
    assert set(order["motion"]) == set(diagnoses) - {"motion"}
    assert "model-discrepancy" not in order["noise-bias"]


def test_findings_of_those_before_are_in_the_evidence(palpate, tmp_path, point_pipeline):
    """A term of 5 kPa is in the combined uncertainty of a diagnosis that states it, and not of one that does not."""
    (tmp_path / "own.py").write_text(
        "from palpate import Diagnosed, Diagnosis, plugin\n"
        "def term(tracks):\n    return {track.name: Diagnosed(terms={'elasticity': 5e3}) for track in tracks}\n"
        "def seen(tracks):\n"
        "    return {track.name: Diagnosed(table={'u': float(track.combined[0])}) for track in tracks}\n"
        "@plugin\ndef palpate_diagnoses():\n"
        "    return {'later': Diagnosis(seen, after=('term',)), 'term': Diagnosis(term), 'apart': Diagnosis(seen)}\n"
    )
    done = palpate("run", point_pipeline, "--out", "out", "--set", 'run.plugins=["own.py"]', cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    tracks = json.loads((tmp_path / "out" / "result.json").read_text())["tracks"]
    for track in tracks.values():
        later, apart = (track["diagnoses"][name]["u"] for name in ("later", "apart"))
        assert later == pytest.approx(np.hypot(apart, 5e3), rel=1e-12)
        assert apart < 5e3
