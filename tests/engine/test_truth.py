"""A truth is a fact of a record: results are compared with it, and nothing that estimates can see it."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from palpate import ConfigurationError, Estimator
from palpate_engine import build_pipeline, load_pipeline, run_pipeline
from palpate_engine.config import Source
from palpate_kit.curves.curve import Curve
from palpate_kit.curves.file_facts import file_facts
from palpate_kit.curves.stated_facts import stated_facts

SHORT = ("trajectory.press.duration=2 s",)
MARK = 123456.789  # Pa, a number that nothing else has


def numbers_within(value, depth=6):
    """Every number that can be reached from an object by its attributes, keys and items."""
    if isinstance(value, bool | str | bytes) or depth == 0 or value is None:
        return
    if isinstance(value, int | float):
        yield float(value)
    elif isinstance(value, np.ndarray):
        yield from value.ravel().astype(float).tolist() if value.dtype.kind in "fiu" else ()
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from numbers_within([key, item], depth)
    elif isinstance(value, list | tuple | set | frozenset):
        for item in value:
            yield from numbers_within(item, depth - 1)
    else:
        for item in getattr(value, "__dict__", {}).values():
            yield from numbers_within(item, depth - 1)


def test_an_estimator_cannot_see_the_truth(point_pipeline, monkeypatch, tmp_path):
    """Neither its settings, nor its problem, nor its samples hold it; the result has it."""
    seen = []
    pipeline = load_pipeline(point_pipeline, (*SHORT, f"device.rig.specimen.elasticity={MARK}"))
    assert MARK in set(numbers_within(pipeline.devices))  # the search finds it where it is
    for track in pipeline.tracks:
        start = type(track.estimator).start

        def watched(self, problem, start=start):
            tracker = start(self, problem)
            run = tracker.run
            seen.append((self, problem))
            tracker.run = lambda samples: (seen.append(samples), run(samples))[1]
            return tracker

        monkeypatch.setattr(type(track.estimator), "start", watched)
    result = run_pipeline(pipeline, tmp_path / "out")
    assert result.truth["elasticity"] == MARK
    assert len(seen) > 2
    assert MARK not in set(numbers_within(seen))


def test_a_stated_truth_changes_no_bit_of_an_estimate(point_pipeline, tmp_path):
    def tracks(truth):
        pipeline = load_pipeline(point_pipeline, SHORT)
        run = pipeline.run.model_copy(update={"truth": truth})
        result = run_pipeline(dataclasses.replace(pipeline, run=run), tmp_path / f"{len(truth)}").table()["tracks"]
        for track in result.values():
            track.pop("seconds_per_sample")
            track.get("comparison", {}).pop("distances", None)
        return json.dumps(result)

    assert tracks({}) == tracks({"elasticity": "50 kPa", "viscosity": "1 Pa*s"})


def test_the_recording_of_a_simulated_rig_states_its_truth(point_pipeline, tmp_path, palpate):
    run_pipeline(load_pipeline(point_pipeline, (*SHORT, "sink.log={type='mcap'}")), tmp_path / "run")
    palpate("replay", str(tmp_path / "run"), "--out", str(tmp_path / "again"))
    assert json.loads((tmp_path / "again" / "result.json").read_text())["truth"] == pytest.approx(
        json.loads((tmp_path / "run" / "result.json").read_text())["truth"]
    )


def test_a_truth_is_stated_by_pipeline_rig_file_and_row_of_curves(point_pipeline, tmp_path):
    text = Path(point_pipeline).read_text()
    (tmp_path / "rig.toml").write_text('truth = "elasticity 40 kPa"\n')
    stated = build_pipeline(Source(text, tmp_path / "p.toml"))
    assert stated.run.truth == {}
    source = Source(text, tmp_path / "p.toml")
    source.override('run.rig="rig.toml"')
    assert build_pipeline(source).run.truth == {"elasticity": "40 kPa"}
    file = tmp_path / "a.csv"
    file.write_text("t,F,z\n")
    (tmp_path / "curves.csv").write_text('curve,truth\na.csv,"elasticity 50 kPa, viscosity 3 Pa*s"\n')
    curve = Curve(str(file), str(file.resolve()))
    assert file_facts([file], [curve], stated_facts([file], ())).of(curve.name).facts.truth.startswith("elasticity 50")


@pytest.mark.parametrize(
    ("assignment", "words"),
    [
        ("run.truth.elasticty='5 kPa'", "elasticity"),
        ("run.truth.elasticity='5 mm'", "is a length, not a pressure"),
        ("rig.truth='five'", "elasticity 112.5 kPa"),
        ("rig.truth='elasticity 5 kPb'", "kPb"),
    ],
)
def test_a_wrong_truth_is_named(point_pipeline, assignment, words):
    with pytest.raises(ConfigurationError, match=words):
        load_pipeline(point_pipeline, (assignment,))


def test_the_promised_interface_has_no_truth_for_estimators():
    assert "truth" not in {name for name in dir(Estimator) if not name.startswith("_")}
