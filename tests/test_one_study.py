"""One study on every screen: terminal, fits.csv, result.json, pages, desk, methods and Python say the same of it.

A study of curves in two groups, each with a height of its own that nobody has stated at first; a run with two tracks; a
map. What two screens say of one number, one fact or one verdict is compared; commands are run as they are printed.
"""

import csv
import html
import json
import re
import shlex
import shutil
import warnings
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import palpate as python
import pytest
from palpate_desk.folder_view import row_messages
from palpate_engine import verdict_rank
from palpate_kit.curves.fit_folder import FitFolder

from tests.command import call

WORDS = ("good", "doubtful", "not determined", "invalid")
QUANTITY = r"(-?[\d.]+|\(-?[\d.]+) ± ([\d.]+)"
pytestmark = [pytest.mark.gate, pytest.mark.slow]
ROOT = Path(__file__).parents[1]


def press(seed, elasticity, thickness, n=250):
    """Time [s], force [N] and height [mm] of a press at 1.5 mm/s on a bonded layer [m], held at the end."""
    random = np.random.default_rng(seed)
    time = np.arange(n) / 125
    depth = np.minimum(2.5e-3, 1.5e-3 * time) - 0.5e-3
    contact = np.maximum(depth, 0.0)
    share = np.sqrt(5e-3 * contact) / thickness
    stiffer = 1 + 1.133 * share + 1.497 * share**2 + 1.469 * share**3 + 0.755 * share**4
    force = 16 / 9 * elasticity * np.sqrt(5e-3) * contact**1.5 * stiffer + 2e-3 * random.standard_normal(n)
    return np.column_stack([time, force, -1e3 * depth + 2e-4 * random.standard_normal(n)])


class Study:
    """The folder of a study, and what its commands have printed."""

    def __init__(self, folder, each):
        self.folder, self.each = folder, each
        (folder / "study").mkdir()
        self.heights = {}
        for group, (name, elasticity) in enumerate((("ctrl", 15e3), ("treat", 22e3))):
            for number in range(each):
                height = 8e-3 + 6e-3 * number / each
                file = f"{name}_{number + 1:02d}.csv"
                table = press(100 * group + number, elasticity * (1 + 0.03 * (number % 3)), height)
                head = "time_s,force_N,height_mm"
                np.savetxt(folder / "study" / file, table, "%.9g", ",", header=head, comments="")
                self.heights[file] = height
        self.printed = self("fit", "study", "--tip", "sphere 5 mm", "--by", "(ctrl|treat)", "--out", "fits")

    def __call__(self, *words):
        words = [*words, "--jobs", "1"] if words[0] == "fit" and not {"--pipeline", "choose"} & {*words} else words
        return call(*words, cwd=self.folder, COLUMNS="79")

    def rows(self, table="fits"):
        with (self.folder / table / "fits.csv").open(newline="") as file:
            return {Path(row["curve"]).stem: row for row in csv.DictReader(file)}

    def text(self, *words):
        done = self(*words)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def page(self, name, *words):
        """The text of a page, its blanks as one."""
        self.text("report", *words, "--out", name)
        return words_of_page((self.folder / name).read_text())


def words_of_page(page):
    page = re.sub(r"<(script|style|svg).*?</\1>", " ", page, flags=re.S)
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", page)).replace("\xa0", " ").split())


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return Study(tmp_path_factory.mktemp("one"), 12)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run with two tracks on a simulated rig, as it is printed, and its folder."""
    folder = tmp_path_factory.mktemp("run")
    pipeline = (ROOT / "pipelines" / "filters.toml").read_text()
    (folder / "two.toml").write_text(pipeline.replace('duration = "10 s"', 'duration = "2 s"'))
    done = call("run", "two.toml", "--out", "two", cwd=folder, COLUMNS="79")
    assert done.returncode == 0, done.stderr
    return folder, done.stdout


def shown(row, name, factor):
    """Value, uncertainty and verdict of a row of fits.csv as numbers in a unit that is shown."""
    value, u = (float(row[key]) * factor for key in (name, f"{name}_combined"))
    return value, u, row[f"{name}_verdict"]


def same_digits(text, number):
    """Whether a printed number is this one, rounded."""
    digits = len(text.partition(".")[2])
    return abs(float(text.lstrip("(")) - number) <= 0.51 * 10.0**-digits + 0.051 * abs(number) * (digits == 0)


def cells_after(text, name):
    """What stands behind the name of a file on its line of a screen: value, uncertainty and word of each value."""
    (line,) = (line for line in text.splitlines() if re.search(rf"\b{name}\b.* ± ", line))
    return [(value, u, " ".join(words.replace("│", " ").split())) for value, u, words in
            re.findall(rf"{QUANTITY}([^±\d-]*)", line)]  # fmt: skip


VALUES = {  # of the user, in place of VALUE
    "--thickness": "12 mm", "--tip": "sphere 5 mm", "--poisson": "0.5", "--base": "bonded", "--delay": "0 ms +- 1 ms",
}  # fmt: skip
UNITS = (("elasticity", 1e-3), ("viscosity", 1.0))


def test_the_terminal_shows_value_and_verdict_as_fits_csv_has_them(study):
    for name, row in study.rows().items():
        for (key, factor), (value, u, word) in zip(UNITS, cells_after(study.printed.stdout, name), strict=True):
            known = shown(row, key, factor)
            assert same_digits(value, known[0]), name
            assert same_digits(u, known[1]), name
            assert word == known[2], name


def test_the_last_line_partitions_the_files_for_each_value(study):
    lines = study.printed.stdout.splitlines()
    last = next(line for line in lines if re.match(r"\d+ files?\. E: ", line))
    assert last.startswith(f"{2 * study.each} files. ")
    for symbol, (name, _) in zip(("E", "eta"), UNITS, strict=True):
        words = re.search(rf"\b{symbol}: ([^;]*)", last)[1]
        counts = {word: int(count) for count, word in re.findall(r"(\d+) ([a-z ]+)", words)}
        known = Counter(row[f"{name}_verdict"] for row in study.rows().values())
        assert {word: count for word, count in counts.items() if count} == dict(known)
    assert "usable" not in study.printed.stdout


def test_a_folder_and_the_page_of_one_curve_name_the_same_cause(study):
    page = study("fit", "study/ctrl_01.csv", "--pipeline", "fits/pipeline.toml", "--out", "cause")
    for text in (study.printed.stdout, page.stdout):
        assert "doubtful[lack-of-fit: thickness] E" in text
        assert "on a half-space" in " ".join(text.split())
        assert re.search(r"help: .*--thickness VALUE", text)


def test_the_page_of_one_curve_has_the_numbers_of_its_row(study):
    study.text("fit", "study/ctrl_01.csv", "--pipeline", "fits/pipeline.toml", "--out", "of-one")
    document = json.loads((study.folder / "of-one" / "ctrl_01" / "result.json").read_text())
    ((_, track),) = document["tracks"].items()
    row = study.rows()["ctrl_01"]
    for name, _ in UNITS:
        found = track["parameters"][name]
        assert found["value"] == pytest.approx(float(row[name]), rel=1e-3)
        assert found["combined"] == pytest.approx(float(row[f"{name}_combined"]), rel=0.05)
        assert found["verdict"] == row[f"{name}_verdict"]


def test_the_desk_shows_value_and_verdict_as_fits_csv_has_them(study):
    folder, rows = FitFolder(study.folder / "fits"), study.rows()
    for message in row_messages(folder, folder.rows):
        for name, _ in UNITS:
            assert message["verdicts"][name] == rows[Path(message["curve"]).stem][f"{name}_verdict"]
        assert "verdict" not in message


def test_python_says_of_a_value_what_fits_csv_says(study):
    with warnings.catch_warnings(action="ignore"):  # of units that are guessed
        fit = python.fit(study.folder / "study" / "ctrl_01.csv", tip="sphere 5 mm", model="dr")
    row = study.rows()["ctrl_01"]
    for name, factor in UNITS:
        assert fit[name].verdict == row[f"{name}_verdict"]
        assert fit.summary().loc[name, "verdict"] == row[f"{name}_verdict"]
        assert fit.summary().loc[name, "value"] == pytest.approx(factor * float(row[name]), rel=1e-3)
        assert f"{fit[name].number}" in str(fit)


def test_repeat_and_report_show_the_same_of_a_group(study):
    study.text("fit", "fits")
    repeat = study.text("repeat", "fits", "--by", "group")
    page = study.page("groups.html", "fits", "--by", "group")
    for group in ("ctrl", "treat"):
        line = next(line for line in repeat.splitlines() if f"│ {group} " in line)
        assert " ± ".join(re.search(QUANTITY, line).groups()) in page


def test_a_unit_is_written_in_one_way(study, run):
    page = study.page("unit.html", "fits", "--by", "group")
    for text in (study.printed.stdout, page.partition("Pipeline as")[0], run[1], study.text("fit", "fits")):
        assert "Pa*s" not in text


def test_every_printed_command_runs_as_it_is_printed(study):
    printed = study.printed.stdout + study.text("fit", "fits")
    commands = re.findall(r"(?:^|[ :`])(palpate [a-z][^\n`]*)", printed, re.MULTILINE)
    assert any("VALUE" in line for line in commands)
    for number, command in enumerate(part for line in dict.fromkeys(commands) for part in line.split(" && ")):
        words = shlex.split(command)[1:]
        for option, value in VALUES.items():
            words = [value if (last, word) == (option, "VALUE") else word for last, word in pairwise(["", *words])]
        assert "VALUE" not in words, command
        words += ["--out", f"again-{number}"] if words[:2] == ["fit", "study"] else []
        if words[:2] == ["fit", "fits"]:  # which would be another folder of fits for all that comes after
            words[1] = shutil.copytree(study.folder / "fits", study.folder / f"fits-{number}").name
        done = study(*words)
        assert done.returncode == 0, command + done.stderr


def test_stating_a_fact_of_one_value_leaves_the_word_of_another(study):
    before = study.rows()
    study.text("fit", "study", "--tip", "sphere 5 mm", "--delay", "0 ms +- 0.5 ms", "--out", "delay")
    for name, row in study.rows("delay").items():
        assert row["verdict"] == row["elasticity_verdict"]
        assert verdict_rank(row["elasticity_verdict"]) <= verdict_rank(before[name]["elasticity_verdict"])


def test_a_height_for_each_curve_is_the_same_in_row_and_page(study):
    lines = [f"study/{file},{1e3 * height:g} mm" for file, height in study.heights.items()]
    (study.folder / "heights.csv").write_text("\n".join(["curve,thickness", *lines]) + "\n")
    study.text("fit", "study", "--tip", "sphere 5 mm", "--out", "high")
    study.text("fit", "high", "--groups", "heights.csv")
    row = study.rows("high")["ctrl_01"]
    assert float(row["elasticity"]) == pytest.approx(15e3, abs=3 * float(row["elasticity_combined"]))
    study.text("fit", "study/ctrl_01.csv", "--pipeline", "high/pipeline.toml", "--out", "high-page")
    document = json.loads((study.folder / "high-page" / "ctrl_01" / "result.json").read_text())
    ((_, track),) = document["tracks"].items()
    assert track["parameters"]["elasticity"]["value"] == pytest.approx(float(row["elasticity"]), rel=1e-3)


def test_a_fact_that_the_file_states_is_stated(study, run):
    assert "poisson = 0.5" in (run[0] / "two.toml").read_text()
    assert "Poisson" not in run[1]


def test_a_run_of_two_tracks_has_a_word_for_each_value_and_none_for_the_run(run):
    folder, printed = run
    tracks = json.loads((folder / "two" / "result.json").read_text())["tracks"]
    for name, track in tracks.items():
        words = [word for *_, word in cells_after(printed, name)]
        assert words == [found["verdict"] for found in track["parameters"].values()]
    done = call("report", "two", "--out", "two.html", cwd=folder)
    assert done.returncode == 0, done.stderr
    page = words_of_page((folder / "two.html").read_text())
    for name in tracks:
        assert name in page
    assert "trust it" not in page


def test_each_screen_says_once_what_its_uncertainty_is(study, run):
    for text in (study.printed.stdout, run[1], study.text("fit", "fits")):
        assert text.count("± one standard uncertainty") == 1


def test_the_methods_count_the_verdicts_that_fits_csv_has(study):
    study.text("report", "fits", "--methods")
    text = " ".join((study.folder / "fits" / "methods.txt").read_text().split())
    for name, _ in UNITS:
        words = Counter(row[f"{name}_verdict"] for row in study.rows().values())
        sentence = re.search(rf"{name.capitalize()} was ([^.]*)\.", text)[1]
        for word, count in words.items():
            assert f"{word} in {count}" in sentence


def test_the_page_of_a_folder_has_value_and_verdict_of_each_curve(study):
    page = study.page("curves.html", "fits")
    for name, row in study.rows().items():
        elasticity, viscosity = (row[f"{key}_verdict"] for key, _ in UNITS)
        assert re.search(rf"{name}\.csv {QUANTITY} kPa {elasticity} {QUANTITY} Pa s {viscosity}", page), name
