"""`palpate.prepare`: one fit for many records, to the digits of a run that is written."""

import numpy as np
import palpate
import pytest
from palpate import ConfigurationError, LogError, PalpateError
from palpate_engine import run_pipeline
from palpate_models import Sphere

TIP = Sphere(radius="5 mm")


def press(seed, n=700, **declared):
    """A press of 4 mm [SI] on 100 kPa."""
    time = np.arange(n) / 500
    depth = 4e-3 * np.sin(np.pi * time / time[-1]) - 1e-3
    speed = np.gradient(depth, time)
    contact = np.maximum(depth, 0.0)
    force = np.maximum(16 / 9 * 1e5 * np.sqrt(5e-3) * contact**1.5 + 8 * 360 * np.sqrt(5e-3 * contact) * speed, 0.0)
    noise = 0.02 * np.random.default_rng(seed).standard_normal(n)
    given = {"timing": "0.2 ms", "tip_mass": 0, "name": f"press {seed}"} | declared
    return palpate.record(time=time, force=force + noise, height=-depth, velocity=-speed, **given)


@pytest.fixture(scope="module")
def fitter():
    return palpate.prepare(tip=TIP, model="dr")


def numbers(fit):
    """All that a fit finds, without the times that it took."""
    return {key: value for key, value in fit.track.document.items() if "per_sample" not in key}


def test_a_record_in_memory_comes_to_what_a_run_writes(fitter, tmp_path):
    found = fitter.fit(press(1))
    written = run_pipeline(fitter._estimator.pipeline(press(1)), tmp_path / "run").table()
    (track,) = written["tracks"].values()
    assert {key: track[key] for key in numbers(found)} == numbers(found)
    assert found.run.document["streams"] == written["streams"]
    assert found.run.document["run"].keys() == written["run"].keys()


@pytest.mark.slow
def test_the_order_of_the_records_changes_no_digit(fitter):
    records = [press(seed, n) for seed, n in enumerate((700, 900, 650))]
    forth = [numbers(fit) for fit in fitter.each(records)]
    back = [numbers(fit) for fit in fitter.each(reversed(records))]
    assert forth == back[::-1]
    assert forth[1] == numbers(palpate.fit(records[1], tip=TIP, model="dr"))


def test_the_force_of_the_model_stands_at_the_samples(fitter):
    found = fitter.fit(press(2))
    measured = found.run.aligned.force
    known = np.isfinite(found.force)
    assert len(found.force) == len(measured)
    assert np.std((measured - found.force)[known]) == pytest.approx(0.02, rel=0.2)


def test_each_tells_how_far_it_is_and_stops_where_it_is_asked_to(fitter):
    told = []
    found = list(fitter.each([press(i) for i in range(3)], progress=told.append, cancelled=lambda: len(told) == 2))
    assert [fit.run.name for fit in found] == ["press 0", "press 1"]
    assert told == [1, 2]


def test_a_record_that_the_alignment_refuses_is_told_and_still_has_its_readings(fitter):
    refused = press(3, alignment={"tare_duration": "nonsense"})
    found = list(fitter.each([press(3), refused]))
    assert isinstance(found[1], PalpateError)
    assert "tare_duration" in str(found[1])
    (readings,) = refused.readings.values()
    assert readings.values.shape == (700, 3)


@pytest.mark.slow
def test_a_folder_is_written_when_it_is_asked_for(fitter, tmp_path):
    found = fitter.fit(press(4))
    assert found.run.tip_mass == 0
    assert found.run._folder is None
    kept = palpate.open_run(found.run.save(tmp_path / "kept"))
    assert kept["dr/casadi-fit"].elasticity.combined == found.elasticity.combined


def test_mistakes_are_named_at_once():
    with pytest.raises(ConfigurationError, match="no model 'hrtz'"):
        palpate.prepare(tip=TIP, model="hrtz")
    with pytest.raises(ConfigurationError, match="needs a tip"):
        palpate.prepare(model="dr").fit(press(4))  # a record of a file may bring its tip
    with pytest.raises(LogError):
        palpate.read("nowhere.csv")
