"""What somebody types first, and gets an answer to."""

import json
import re

import pytest


@pytest.mark.parametrize(("words", "name"), [(["run", "point"], "point"), (["check", "ur3e.toml"], "ur3e")])
def test_a_template_that_was_not_written_is_named_with_its_command(palpate, words, name):
    done = palpate(*words)
    assert done.returncode == 2
    assert f"type palpate init {name}, which writes {name}.toml" in done.stderr


def test_init_alone_asks_which(palpate, tmp_path, monkeypatch):
    done = palpate("init")
    assert done.returncode == 2
    assert "a point palpation on a simulated rig" in done.stderr
    assert "no answer; palpate init NAME writes one of point, chirp, log, ur3e" in done.stderr
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr("typer.prompt", lambda *_, **__: "raster")
    assert "written: raster.toml" in palpate("init").stdout
    done = palpate("init", "--plugin", "tip")
    assert (done.returncode, "palpate init --plugin tip NAME" in done.stderr) == (2, True)


def test_list_takes_a_word(palpate):
    shown = palpate("list", "Maxwell").stdout
    assert "  burgers " in shown
    assert "[model.*]" in shown
    assert "[device.*]" not in shown
    assert set(json.loads(palpate("list", "estimator", "--json").stdout)) >= {"estimator"}
    done = palpate("list", "maxwel l")
    assert done.returncode == 2
    assert "did you mean 'maxwell'" in done.stderr


def test_describe_alone_lists(palpate):
    assert palpate("describe").stdout == palpate("list").stdout


@pytest.mark.slow
def test_the_word_of_a_verdict_has_its_cause_and_what_helps_below_it(palpate, point_pipeline):
    few = ("--set", "trajectory.press.duration=1 s", "--set", 'run.tracks=["*/ekf"]')
    shown = palpate("run", point_pipeline, *few).stdout
    words = {word for word in ("doubtful", "invalid", "not determined") if re.search(rf"  {word}( |$)", shown, re.M)}
    assert words
    assert all(f"\n{word}[" in shown for word in words)
    assert "\n  help: " in shown


@pytest.mark.slow
def test_a_run_without_tracks_records(palpate, point_pipeline, tmp_path):
    few = ("--set", "trajectory.press.duration=1 s", "--set", "run.tracks=[]", "--set", 'sink.log.type="mcap"')
    done = palpate("run", point_pipeline, *few, "--out", "out")
    assert done.returncode == 0, done.stderr
    assert "readings" in done.stdout
    assert "verdict" not in done.stdout
    again = palpate("replay", "out", "--out", "again", "--add-estimator", "ekf", "--add-model", "dr")
    assert again.returncode == 0, again.stderr
    assert "/ekf" in again.stdout
