"""How far long work is, without a terminal."""

import time

import pytest
from palpate_kit.terminal import progress as module
from palpate_kit.terminal.progress import progress, report_progress


@pytest.fixture
def soon(monkeypatch):
    """Lines every millisecond, in place of every 10 s."""
    monkeypatch.setattr(module, "_LINE_INTERVAL", 1e-3)


def told(capsys, wanted):
    """Standard error from the first line that says what is wanted; fails after 10 s."""
    text, until = "", time.monotonic() + 10.0
    while wanted not in text:
        assert time.monotonic() < until, text
        time.sleep(1e-3)
        text += capsys.readouterr().err
    return text


def test_a_line_says_how_far_it_is(soon, capsys):
    with progress("export of x.csv", "messages"):
        told(capsys, "export of x.csv, after 0 s\n")
        report_progress(1234.0)
        told(capsys, "export of x.csv: 1 234 messages, after 0 s\n")
        report_progress(5000, 20000)
        told(capsys, "export of x.csv: 5 000 of 20 000 messages, after 0 s\n")
    capsys.readouterr()
    time.sleep(0.02)
    assert capsys.readouterr().err == ""


def test_what_is_done_within_other_work_stands_behind_it(soon, capsys):
    with progress("fit", "logs", 3):
        report_progress(1)
        with progress("two.csv", "s"):
            report_progress(7.0, 20.0, 0.5)
            told(capsys, "fit: 1 of 3 logs, two.csv: 7 of 20 s, after 0 s\n")
        told(capsys, "fit: 1 of 3 logs, after 0 s\n")


def test_what_fails_is_not_shown_any_more(soon, capsys):
    with pytest.raises(ValueError, match="x"), progress("one"):
        raise ValueError("x")
    report_progress(5)
    with progress("two"):
        assert "one" not in told(capsys, "two, after 0 s\n")


def test_nobody_hears_of_short_work(capsys):
    with progress("short"):
        report_progress(1)
    assert capsys.readouterr().err == ""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("info", "LOG"), "info of log.mcap"),
        (("log", "export", "LOG", "-o", "x.csv"), "export of log.mcap"),
        (("log", "recover", "LOG", "-o", "x.mcap"), "recover log.mcap"),
        (("sweep", "PIPELINE", "--out", "swept", "--jobs", "1"), "sweep: 1 of 2 combinations, after "),
    ],
    ids=lambda value: " ".join(value[:2]) if isinstance(value, tuple) else "",
)
def test_commands_say_how_far_they_are(soon, palpate, point_pipeline, tmp_path, arguments, said):
    text = point_pipeline.read_text().replace('duration = "10 s"', 'duration = "1 s"')
    text = text.replace("seed = 1\n", 'seed = 1\ntracks = ["dr/ekf"]\n', 1)
    point_pipeline.write_text(text + '\n[sweep]\n"run.seed" = [1, 2]\n')
    if "LOG" in arguments:
        assert palpate("run", point_pipeline, "--out", tmp_path / "run").returncode == 0
    places = {"LOG": tmp_path / "run" / "log.mcap", "PIPELINE": point_pipeline}
    done = palpate(*(places.get(word, word) for word in arguments))
    assert done.returncode == 0, done.stderr
    assert said in done.stderr
