"""All questions about a folder and its rig in one go: on a terminal they are asked, answers stand in rig.toml."""

import os
import pty
import re
import select
from dataclasses import replace

import numpy as np
import pytest
from palpate import Condition, ConfigurationError, Flag
from palpate_engine import TrackResult, UncertainValue, read_rig
from palpate_fits.file_questions import FileQuestion
from palpate_fits.sitting import ask_fact, ask_of_files, keep_answers
from palpate_kit.curves.open_facts import open_facts
from palpate_kit.curves.stated_facts import stated_facts

from tests import processes
from tests.fits.test_fit_files import rows_of

COUNT = 40
ANSWERS = {
    "Which tip": "paraboloid 3 mm",
    "rows per second": "250 Hz",
    "can be F1": "F1 (N)",
    "one V of": "10 N",
    "unit of the position": "mm",
    "unit of the force": "N",
    "How late": "0 ms +- 0.1 ms",
    "How thick": "half-space",
    "What mass": "0 g",
}


def ramp(modulus, seed, n=1250):
    """Time [s], depth [m] and force [N]: air, a smooth ramp, a hold, and back."""
    random = np.random.default_rng(seed)
    time = np.arange(n) / 250
    corners = np.interp(time, [0, 1, 2.5, 3.5, 5], np.array([-0.5, -0.5, 1.6, 1.6, -0.5]) * 1e-3)
    window = np.hanning(41)
    depth = np.convolve(np.pad(corners, 20, "edge"), window / window.sum(), "valid")
    contact, speed = np.maximum(depth, 0), np.gradient(depth, time)
    force = 16 / 9 * modulus * np.sqrt(3e-3) * contact**1.5 + 8 * 80 * np.sqrt(3e-3 * contact) * speed
    return time, depth + 2e-7 * random.standard_normal(n), force + 1e-3 * random.standard_normal(n)


# Head, separator, decimal mark and columns of each: four lack what only a person knows.
DIALECTS = (
    ("time (s),force (N),depth (mm)", ",", ".", lambda t, d, f: (t, f, 1e3 * d)),
    ("Load [N],Ext [mm]", ",", ".", lambda t, d, f: (f, 1e3 * d)),
    ("time_s,bridge [V],depth_mm", ",", ".", lambda t, d, f: (t, f / 10, 1e3 * d)),
    ("t (s),F1 (N),F2 (N),depth (mm)", ",", ".", lambda t, d, f: (t, f, 1.5 * f, 1e3 * d)),
    ("time,force,depth", ",", ".", lambda t, d, f: (t, f, 1e3 * d)),
    ("Zeit [s];Kraft [N];Weg [mm]", ";", ",", lambda t, d, f: (t, f, 1e3 * d)),
    ("t [ms]\tForce [mN]\tHeight [um]", "\t", ".", lambda t, d, f: (1e3 * t, 1e3 * f, -1e6 * d)),
    ("# columns: t z F\n# units: s m N", " ", ".", lambda t, d, f: (t, -d, f)),
    ("time / s,F / N,z / mm", ",", ".", lambda t, d, f: (t, f, -1e3 * d)),
)


def modulus_of(number):
    return 40e3 + 2e3 * number


def folder_of_dialects(folder, count=COUNT, seed=0):
    folder.mkdir()
    for number in range(count):
        head, separator, decimal, columns = DIALECTS[number % len(DIALECTS)]
        table = columns(*ramp(modulus_of(number), seed + number))
        rows = (separator.join(f"{x:.9g}".replace(".", decimal) for x in row) for row in zip(*table, strict=True))
        (folder / f"c{number}.txt").write_text("\n".join([head, *rows]) + "\n")


def on_a_terminal(*words):
    """What a command prints on a terminal, and the questions that it asks, each answered."""
    terminal, end = pty.openpty()
    environment = os.environ | {"COLUMNS": "200", "NO_COLOR": "1"}
    child = processes.start(processes.PALPATE, *words, stdin=end, stdout=end, stderr=end, env=environment)
    os.close(end)
    said, asked, begin = "", [], 0
    while select.select([terminal], [], [], 120)[0]:
        try:
            data = os.read(terminal, 1 << 16).decode(errors="replace")
        except OSError:  # the end, on Linux
            break
        said += data
        if re.search(r"\[Enter: [^\]]*\]\s*$", said[begin:]):
            question = said[begin:].rstrip().splitlines()[-1]
            asked.append(question)
            answer = next((text for words, text in ANSWERS.items() if words in question), "")
            begin = len(said)
            os.write(terminal, f"{answer}\n".encode())
    os.close(terminal)
    return child.wait(60), said, asked


@pytest.mark.slow
def test_forty_files_in_nine_dialects_are_right_after_one_sitting_and_a_second_folder_asks_nothing(
    tmp_path, monkeypatch, palpate
):
    monkeypatch.chdir(tmp_path)
    folder_of_dialects(tmp_path / "first")
    code, said, asked = on_a_terminal("fit", "first", "--out", "fits")
    assert code == 0, said
    of_rig = [text for text in asked if 'As in "' in text]
    assert len(of_rig) <= 7  # the tip, and six
    assert len(asked) - len(of_rig) <= 6  # four dialects, one of which lacks two units
    assert "How late" in of_rig[1]  # viscosity moves most
    assert "(eta " in of_rig[1]  # by what is said
    rows = rows_of(tmp_path / "fits")
    assert len(rows) == COUNT
    for number in range(COUNT):
        row = rows[f"c{number}"]
        assert float(row["elasticity"]) == pytest.approx(modulus_of(number), rel=0.01), number
        assert abs(float(row["viscosity"]) - 80) < 4 * float(row["viscosity_combined"]), number
        assert row["verdict"] == "good", number
    facts = read_rig(tmp_path / "first" / "rig.toml")
    assert facts.units["bridge [V]"] == "10 N"
    assert facts.delay == "0 ms +- 0.1 ms"
    folder_of_dialects(tmp_path / "second", 9, seed=100)
    code, said, asked = on_a_terminal("fit", "second", "--rig", "first/rig.toml", "--out", "more")
    assert (code, asked) == (0, []), said
    alone = palpate("fit", "second", "--rig", "first/rig.toml", "--out", "again")  # without a terminal
    assert alone.returncode == 0, alone.stderr
    assert rows_of(tmp_path / "again") == rows_of(tmp_path / "more")


@pytest.mark.slow
def test_without_a_terminal_what_can_be_fitted_is_and_one_line_is_there_to_copy(tmp_path, monkeypatch, palpate):
    monkeypatch.chdir(tmp_path)
    folder_of_dialects(tmp_path / "first", 5)
    done = palpate("fit", "first", "--tip", "paraboloid 3 mm", "--out", "fits")
    assert done.returncode == 1
    assert not (tmp_path / "first" / "rig.toml").exists()
    assert "first/c2.txt: columns.force.scale: how many N" in done.stderr
    row = rows_of(tmp_path / "fits")["c1"]  # without a time
    assert (row["elasticity_verdict"], row["viscosity_verdict"]) == ("good", "needs rate")
    assert "state: palpate fit first --tip 'paraboloid 3 mm' --" in done.stdout


class Person:
    """Gives answers one after the other, and notes what was asked."""

    def __init__(self, *answers):
        self.answers, self.asked = [*answers], []

    def __call__(self, text):
        self.asked.append(text)
        return self.answers.pop(0)


def test_an_answer_that_is_none_is_asked_again_and_an_empty_one_leaves_the_fact_open(tmp_path, capsys):
    stated = stated_facts([tmp_path], ())
    person = Person("5 kPa", "22 mm")
    found = ask_fact(stated, "thickness", "not known; 11 % lower", person)
    assert (found.facts.thickness, len(person.asked)) == ("22 mm", 2)
    assert "not a length" in capsys.readouterr().err
    assert person.asked[0] == 'How thick is the specimen? As in "22 mm" [Enter: not known; 11 % lower]'
    assert ask_fact(stated, "thickness", "", Person("")).facts.thickness is None


def test_one_question_stands_for_all_files_that_it_concerns_and_the_answers_are_kept(tmp_path):
    volts = FileQuestion("units", "bridge [V]", "how many N one V is", "", True)
    two = FileQuestion("columns", "force", "the force can be F1, F2", "", True, ("F1", "F2"))
    guess = FileQuestion("units", "z", "unit of the position: mm is a guess", "", False, (), "mm")
    questions = {"a.csv": volts, "b.csv": volts, "c.csv": two, "d.csv": guess}
    person = Person("10 N", "F3", "F2", "")
    found = ask_of_files(stated_facts([tmp_path], ["rig.tip=paraboloid 3 mm"]), questions, person)
    assert len(person.asked) == 4
    assert person.asked[0].startswith("a.csv and 1 more: how many N")
    assert "[Enter: they are not read]" in person.asked[0]
    assert "[Enter: mm]" in person.asked[3]
    keep_answers(found)
    facts = read_rig(tmp_path / "rig.toml")
    assert facts.units == {"bridge [V]": "10 N", "z": "mm"}
    assert facts.columns == {"force": ("F2",)}
    assert facts.tip == "paraboloid 3 mm"


def test_comments_of_a_person_stay_where_answers_are_added(tmp_path):
    rig = tmp_path / "rig.toml"
    rig.write_text('# the blue stand\ntip = "paraboloid 3 mm" # new\n\n[measured.mass]\nvalue = 0.1\n')
    keep_answers(stated_facts([tmp_path], ()).answered(delay="0 ms +- 1 ms"))
    text = rig.read_text()
    assert text.startswith('# the blue stand\ntip = "paraboloid 3 mm" # new\n')
    assert read_rig(rig).delay == "0 ms +- 1 ms"
    assert read_rig(rig).measured == {"mass": {"value": 0.1}}


def test_a_pipeline_that_is_called_rig_is_no_file_of_facts_and_stays_as_it_is(tmp_path, capsys):
    text = '[device.arm]\ntype = "sim"\n'
    (tmp_path / "rig.toml").write_text(text)
    stated = stated_facts([tmp_path], ())
    assert not stated.is_read
    keep_answers(stated.answered(thickness="22 mm"))
    assert "are not kept" in capsys.readouterr().err
    assert (tmp_path / "rig.toml").read_text() == text
    with pytest.raises(ConfigurationError, match="is a pipeline"):
        stated_facts([tmp_path], [f"run.rig={tmp_path / 'rig.toml'}"])


def test_two_files_of_facts_are_no_choice_of_the_program(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "rig.toml").write_text("")
    with pytest.raises(ConfigurationError, match="--rig FILE"):
        stated_facts([tmp_path / "a", tmp_path / "b"], ())


def test_a_fact_that_a_finding_names_is_asked_first():
    """24 files looked like a layer, and nobody was asked how thick it is."""
    values = {"elasticity": UncertainValue(1e5, 1e3, "Pa", verdict="doubtful")}
    layer = Flag("lack-of-fit", "it grows faster; 96 %", "doubtful", {"elasticity": 4e4}, remedy="--thickness VALUE",
                 moves=("elasticity",))  # fmt: skip
    late = Condition("delay", "force in time", "--delay VALUE", "10 ms", {"elasticity": 5e3})
    track = TrackResult("dr", "fit", 9, values, values["elasticity"], 0.0, 1.0, (layer,), 0.0, conditions=(late,))
    assert [(fact.key, fact.effect) for fact in open_facts([track])] == [
        ("thickness", "it grows faster"),
        ("delay", "force in time: 10 ms makes E 5 % higher"),
    ]
    good = replace(track, parameters={"elasticity": replace(values["elasticity"], verdict="good")})
    assert [fact.key for fact in open_facts([good])] == ["delay"]
