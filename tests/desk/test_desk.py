"""The desk without a page: each action is a command, and can be taken back."""

import itertools
import os
import shutil
import signal
import subprocess
import time

import numpy as np
import pytest
from palpate import ConfigurationError, OutputError
from palpate_desk.action import Action
from palpate_desk.command_gate import demand_allowed_setting
from palpate_desk.curve_answers import curve_answer
from palpate_desk.desk import Desk, one_curve, writing
from palpate_desk.page_messages import read_message

from tests.curves.conftest import NAMES

_KEPT = ("pipeline.toml", "own.toml", "review.json", "curves.csv", "rig.toml")


def contents(desk):
    """What is set and marked in the folder."""
    return {name: (desk.path / name).read_text() for name in _KEPT if (desk.path / name).exists()}


ACTIONS = [
    lambda desk: desk.mark(NAMES[0], "bad", 'the tip\'s "edge" slipped, and more'),
    lambda desk: desk.mark(NAMES[0], "good", ""),
    lambda desk: desk.set('estimator.fit.segment="0.1 s..0.9 s"', f"curve={NAMES[1]}"),
    lambda desk: desk.set("estimator.fit.segment=load", "S1"),
    lambda desk: desk.set("estimator.fit.solver=trf", None),
    lambda desk: desk.set_part("tip", "sphere diameter 9 mm"),
    lambda desk: desk.state_facts({"thickness": "8 mm", "poisson": "0.5 +- 0.01"}),
    lambda desk: desk.set_part("model", "hunt-crossley"),
]


@pytest.mark.slow
@pytest.mark.parametrize("act", ACTIONS)
def test_an_action_is_taken_back_and_the_next_one_is_the_one_before(desk, act):
    desk.mark(NAMES[5], "bad", "first")
    before = contents(desk)
    act(desk)
    assert contents(desk) != before
    desk.undo()
    assert {**contents(desk), "own.toml": ""} == {**before, "own.toml": ""}
    assert not desk.folder.own
    assert desk.folder.marks.rejected == {NAMES[5]: "first"}
    desk.undo()
    assert not desk.folder.marks.rejected
    with pytest.raises(ConfigurationError, match="nothing to undo"):
        desk.undo()


@pytest.mark.slow
def test_the_history_in_another_folder_gives_the_same_bytes(desk, tmp_path, palpate):
    other = tmp_path / "other"
    shutil.copytree(desk.path, other)
    for act in ACTIONS[:4]:
        act(desk)
    desk.take_rows(curve_answer(desk.reader(NAMES[1]), desk.curve(NAMES[1]), True).rows)
    desk.note(one_curve(NAMES[1]))
    desk.state_facts({"thickness": "8 mm"})
    desk.state_facts({"poisson": "0.5 +- 0.01"})
    desk.undo()
    desk.set_part("tip", "paraboloid 4 mm")
    desk.undo()
    desk.set_part("tip", "paraboloid 5 mm")
    desk.take_rows(curve_answer(desk.reader(NAMES[0]), desk.curve(NAMES[0]), True).rows)
    desk.note(one_curve(NAMES[0]))
    desk.compact()
    for command in desk.history.commands:
        done = palpate(*Action.of(command).words(str(other)))
        assert done.returncode == 0, done.stderr
    for name in (*_KEPT, "fits.csv"):
        assert (other / name).read_bytes() == (desk.path / name).read_bytes(), name


@pytest.mark.parametrize(
    "action",
    [
        Action("repeat review", (("--reject", "a b's.csv"), ("--reason", 'it "slipped" $HOME'))),
        Action("fit", (("--where", "curve='a b.csv'"), ("--set", "estimator.fit.segment=load"), ("--no-refit", ""))),
        Action("fit"),
        Action("repeat review", (("--reject", "--plugin=evil.py"), ("--reason", ""))),
        Action("repeat review", (("--accept", "$out"),)),
        Action("fit", (("--tip", "paraboloid 3 mm"), ("--no-refit", ""), ("--out", "$out")), "a folder; rm -rf ~"),
        Action("fit", (("--pipeline", "$out/pipeline-2.toml"), ("--out", "$out/figures/a b")), "/curves/a b.csv"),
    ],
)
def test_a_command_is_read_back_as_it_was_written(action, tmp_path):
    """Also by a shell, for which no word becomes another, and no value an option."""
    assert Action.of(action.text) == action
    script = 'out="$1"\npalpate() { for word; do printf "%s\\n" "$word"; done; }\n'
    for text in (action.text, action.text_for("/the folder")):
        said = subprocess.check_output(["sh", "-c", script + text, "sh", "/the folder"], text=True)
        assert said.splitlines() == action.words("/the folder")
    assert not [word for word in action.words("/the folder") if word.startswith("--plugin")]


def test_a_torn_line_of_the_history_is_left_out_and_written_over(desk):
    desk.mark(NAMES[0], "good", "")
    whole = desk.history.path.read_text()
    desk.history.path.write_text(whole + '2,2026-11-24,"palpate')
    assert len(desk.history.commands) == 1
    desk.mark(NAMES[1], "good", "")
    assert [line.split(",")[0] for line in desk.history.path.read_text().splitlines()] == ["number", "1", "2"]


def test_a_click_and_the_table_say_the_same_to_the_digit(desk):
    """In any order, since a fit begins from the record and its settings alone."""
    for name in (NAMES[6], NAMES[1], NAMES[6]):
        answer = curve_answer(desk.reader(name), desk.curve(name), True)
        (row,) = desk.folder.rows_of(name)
        assert {key: row.cells[key] for key in answer.rows[0]} == answer.rows[0]
        assert answer.columns.shape == (3, len(answer.time))


def test_a_curve_that_cannot_be_read_has_an_error_and_one_that_cannot_be_fitted_its_readings(desk, folder):
    (folder / NAMES[0]).write_text("time_s,force_N,height_mm\n")
    broken = curve_answer(desk.reader(NAMES[0]), desk.curve(NAMES[0]), True)
    assert broken.error
    assert broken.rows[0]["error"] == broken.error
    text = (folder / NAMES[1]).read_text().splitlines()
    (folder / NAMES[1]).write_text("\n".join(text[:6]) + "\n")
    short = curve_answer(desk.reader(NAMES[1]), desk.curve(NAMES[1]), True)
    assert short.rows[0].get("error") or short.rows[0]["verdict"] == "invalid"
    assert len(short.time) == 5


@pytest.mark.parametrize(
    "assignment",
    [
        "device.log.file=/etc/passwd",
        "run.plugins=['x.py']",
        "run.calibration=x.toml",
        "sink.log.type=mcap",
        "estimator.fit",
        "indenter.tip.points=/etc/passwd",
        'indenter.tip={type="profile", points="/etc/passwd"}',
        "model.dimensionality-reduction.thickness={height='5 mm', table='x.csv'}",
        r'indenter.tip={type="profile", "po\u0069nts"="/etc/passwd"}',
        "indenter.tip.'points'=/etc/passwd",
        r'indenter.tip."po\u0069nts"=/etc/passwd',
        "'indenter' . tip . \"points\" = /etc/passwd",
        r'model.mine={type="dimensionality-reduction", thickness=[{"t\u0061ble"="x.csv"}]}',
    ],
)
def test_the_page_cannot_name_files_or_code(desk, assignment):
    with pytest.raises(ConfigurationError):
        demand_allowed_setting(assignment)
    before = contents(desk)
    with pytest.raises(ConfigurationError):
        desk.set(assignment, None)
    with pytest.raises(ConfigurationError, match="names no files"):
        desk.set_part("tip", "profile points /etc/passwd")
    assert contents(desk) == before
    demand_allowed_setting('indenter.tip={type="sphere", radius="4 mm"}')


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"do": "delete"}', "delete"),
        ('{"do": "mark", "curve": "a", "mark": "worst"}', "good"),
        ('{"do": "curve"}', "curve"),
        ('{"do": "filter", "words": "x", "path": "/"}', "path"),
        ("stop", "JSON"),
        ('{"do": "mark", "curve": "' + "a" * 2000 + '", "mark": "good"}', "1000"),
    ],
)
def test_messages_are_of_a_closed_list(text, words):
    with pytest.raises(ConfigurationError, match=words):
        read_message(text)


def _work(path, pipe):
    """Marks, settings, fits and undoing without an end, each told when it is done."""
    desk = Desk(path)
    rows = {name: [row.cells for row in desk.folder.rows_of(name)] for name in NAMES}
    for count in itertools.count():
        name = NAMES[count % 8]
        desk.mark(name, "bad", f"reason {count}")
        os.write(pipe, f"{name} {count}\n".encode())
        desk.set(f'estimator.fit.segment="0.1 s..{0.7 + 0.01 * (count % 9):.2f} s"', f"curve={name}")
        key = desk.folder.key(name)
        desk.take_rows([{**cells, "settings": key} for cells in rows[name]])
        desk.note(one_curve(name))
        desk.undo()
        desk.compact()


@pytest.mark.slow
def test_a_kill_at_any_of_fifty_moments_leaves_whatever_was_told(desk):
    random = np.random.default_rng(36)
    for _ in range(50):
        reading, writing_end = os.pipe()
        child = os.fork()
        if not child:
            try:
                _work(desk.path, writing_end)
            finally:
                os._exit(1)
        os.close(writing_end)
        said = os.read(reading, 1 << 16)  # the first is done
        time.sleep(random.uniform(0, 0.25))
        os.kill(child, signal.SIGKILL)
        assert os.WIFSIGNALED(os.waitpid(child, 0)[1])
        with open(reading, "rb") as pipe:
            said += pipe.read()
        left = Desk(desk.path)
        assert left.folder.names == sorted(NAMES)
        assert all(len(left.folder.rows_of(name)) == 1 and left.folder.rows_of(name)[0].cells for name in NAMES)
        told = dict(line.split() for line in said.decode().splitlines())
        reasons = {name: int(text.split()[1]) for name, text in left.folder.marks.rejected.items()}
        assert all(reasons[name] >= int(count) for name, count in told.items())
        rows = left.history.path.read_text().splitlines()[1:]
        numbers = [int(line.split(",")[0]) for line in rows[: len(left.history.commands)]]
        assert numbers == list(range(1, len(numbers) + 1))
        with writing(desk.path):
            left.mark(NAMES[0], "none", "")
            left.compact()
    assert {row.state for row in Desk(desk.path).folder.rows} <= {"current", "stale"}


def test_a_mark_on_no_curve_and_a_rejection_without_a_reason_are_refused(desk):
    with pytest.raises(ConfigurationError, match="did you mean"):
        desk.mark("curves/S1_00.csv", "good", "")
    with pytest.raises(ConfigurationError, match="why"):
        desk.mark(NAMES[0], "bad", "  ")
    assert not desk.history.commands


def test_a_second_writer_is_refused_by_name(desk):
    other = r"another palpate desk \(process \d+\)"
    with writing(desk.path), pytest.raises(OutputError, match=other), writing(desk.path):
        pass
    with writing(desk.path):
        pass


def test_what_another_program_writes_is_seen(desk):
    assert not desk.changed_outside
    (desk.path / "own.toml").write_text(f'["{NAMES[0]}"]\nset = ["estimator.fit.segment=load"]\n')
    assert desk.changed_outside
    desk.reload()
    assert desk.left() == [NAMES[0]]
    assert not Desk(desk.path).changed_outside


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["curves"], 'give the tip of its curves: --tip "sphere 3 mm"'),
        (["none"], "no such file or folder"),
        (["fits", "--tip", "paraboloid 3 mm"], "has its settings"),
        (["curves", "--history"], "has no fits.csv"),
        (["fits", "--history"], "has no history"),
        (["curves", "--tip", "paraboloid 3 mm", "--read-only"], "makes none"),
        (["fits", "--groups", "none.csv"], "no such file"),
    ],
)
def test_a_mistake_is_named(folder, palpate, options, words):
    refused = palpate("desk", *options, "--no-browser")
    assert refused.returncode == 2
    assert words in " ".join(refused.stderr.split())
