"""One study on every screen: terminal, fits.csv, result.json, pages, desk, methods and Python say the same of it.

A study of curves in two groups, each with a height of its own that nobody has stated at first; a run with two tracks; a
map. What two screens say of one number, one fact or one verdict is compared; commands are run as they are printed.
"""

import json
import math
import re
import shutil
import warnings
from collections import Counter
from pathlib import Path

import palpate as python
import pytest
from palpate_desk.folder_view import row_messages
from palpate_engine import verdict_rank
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.runs.lump_table import chance
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_report.run_contents import RunContents
from palpate_report.run_figures import draw
from palpate_report.run_report import subject_of
from palpate_report.run_verdict import judge

from tests.command import call
from tests.screen_words import banned_phrases, unknown_heads, unknown_verdicts
from tests.study_screens import Study, commands, options, words_of_page

QUANTITY = r"(-?[\d.]+|\(-?[\d.]+) ± ([\d.]+)"
pytestmark = [pytest.mark.gate, pytest.mark.slow]
ROOT = Path(__file__).parents[1]


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


AREA = (
    'run.tracks=["*/smoother"]', 'trajectory.raster.size=["24 mm", "16 mm"]', "trajectory.raster.pitch=4 mm",
    'trajectory.raster.centre=["-16 mm", "6 mm"]', "trajectory.raster.speed=8 mm/s",
    "estimator.smoother.sweep_speed=8 mm/s",
)  # fmt: skip
SETTINGS = [word for setting in AREA for word in ("--set", setting)]


@pytest.fixture(scope="module")
def area(tmp_path_factory):
    """A map over the sphere of the example, its lumps as printed, and its folder."""
    folder = tmp_path_factory.mktemp("area")
    done = call("run", ROOT / "pipelines" / "raster.toml", *SETTINGS, "--out", "area", cwd=folder, COLUMNS="79")
    assert done.returncode == 0, done.stderr
    printed = [call("map", *words, "area", cwd=folder, COLUMNS="79") for words in ((), ("lumps",))]
    assert [made.returncode for made in printed] == [0, 0], printed
    page = call("report", "area", cwd=folder)
    assert page.returncode == 0, page.stderr
    return folder, done.stdout, printed[1].stdout


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


def test_every_command_of_the_study_runs_as_it_is_printed(study):
    printed = study.printed.stdout + study.text("fit", "fits")
    assert "VALUE" in printed
    for number, words in enumerate(commands(printed)):
        words += ["--out", f"again-{number}"] if words[:2] == ["fit", "study"] else []
        if words[:2] == ["fit", "fits"]:  # which would be another folder of fits for all that comes after
            words[1] = shutil.copytree(study.folder / "fits", study.folder / f"fits-{number}").name
        done = study(*words)
        assert done.returncode == 0, f"{words}: {done.stderr}"


def test_every_command_of_a_run_and_of_a_map_runs_as_it_is_printed(run, area):
    for folder, printed, *_ in (run, area):
        shown = list(commands(printed))
        assert [words[0] for words in shown].count("report") == 2
        for words in shown:
            done = call(*words, cwd=folder)
            assert done.returncode == 0, f"{words}: {done.stderr}"


def test_an_option_that_states_a_fact_belongs_to_the_command_that_printed_it(study, area):
    page = ("fit", "study/ctrl_01.csv", "--pipeline", "fits/pipeline.toml")
    printed = study.text(*page, "--out", "open")
    assert "--thickness" in options(printed)
    height = ("--thickness", f"{1e3 * study.heights['ctrl_01.csv']:g} mm")  # the last of an option counts
    assert "--thickness VALUE" not in study.text(*page, *options(printed), *height, "--out", "stated")
    folder, printed, _ = area
    stated = call(
        "run", ROOT / "pipelines" / "raster.toml", *SETTINGS, *options(printed), "--out", "stated", cwd=folder
    )
    assert stated.returncode == 0, stated.stderr
    assert options(printed)
    assert not options(stated.stdout)


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


def crosses(figure):
    """Places [mm] of the crosses of a figure of a map."""
    lines = [line for axis in figure.axes for line in axis.lines if line.get_marker() == "+"]
    return [(float(x), float(y)) for line in lines for x, y in zip(*line.get_data(), strict=True)]


def test_a_lump_has_one_place_on_terminal_page_picture_and_in_json(area):
    folder, _, printed = area
    lumps = json.loads((folder / "area" / "maps" / "lumps.json").read_text())["lumps"]
    places = [(1e3 * lump["x"], 1e3 * lump["y"]) for lump in lumps]
    assert places
    contents = RunContents.read(folder / "area")
    picture = draw("map", subject_of(contents, judge(contents)))
    assert crosses(picture.figure) == places
    labels = [text.get_text() for text in picture.figure.axes[0].texts]
    assert labels == [f"{number}: p {chance(lump['p'])}" for number, lump in enumerate(lumps, 1)]
    of_map = json.loads(call("map", "area", "--json", cwd=folder).stdout)["lumps"]
    assert [(1e3 * lump["place"][0], 1e3 * lump["place"][1]) for lump in of_map] == places
    page = words_of_page((folder / "area" / "report.html").read_text()).partition("Lumps")[2]
    for (x, y), lump in zip(places, lumps, strict=True):
        contrast = f"{100 * lump['contrast']:.1f} ± {100 * lump['contrast_std']:.1f}"
        row = rf"(?<![\d.-]){x:.1f} .*?(?<![\d.-]){y:.1f} .*?{contrast} .*\S"  # each place with its ±, then the width
        assert re.search(row, printed), row
        assert re.search(row, page), row


def test_a_map_has_its_range_on_every_screen(area):
    folder, printed, _ = area
    ((_, track),) = json.loads((folder / "area" / "result.json").read_text())["tracks"].items()
    page = words_of_page((folder / "area" / "report.html").read_text())
    for name, symbol, factor in (("elasticity", "E", 1e-3), ("viscosity", "eta", 1.0)):
        found = track["parameters"][name]
        ends = " to ".join(f"{factor * found['places'][end]:.4g}" for end in ("low", "high"))
        one_place = math.sqrt(found["combined"] ** 2 - found["places"]["spread"] ** 2)
        text = f"{ends}, mean {value_with_uncertainty(factor * found['value'], factor * one_place)}"
        assert re.search(rf"^  {symbol} +{text} .*{found['verdict']}", printed, re.MULTILINE)
        assert page.count(text) == 3  # at the top, as a number of the main track, in the table of all tracks
        assert f"{name} {text}" in page.partition("All tracks")[2]


@pytest.fixture(scope="module")
def screens(study, run, area):
    """The text of every screen of the study, the run and the map, by its name."""
    (study.folder / "bare.csv").write_text((study.folder / "study" / "ctrl_01.csv").read_text().replace("_N", "", 1))
    folder, printed = run
    assert call("report", "two", "--out", "words.html", cwd=folder).returncode == 0
    page = ("fit", "study/ctrl_01.csv", "--pipeline", "fits/pipeline.toml", "--out", "page")
    return {
        "fit of a folder": study.printed.stdout + study.printed.stderr,
        "fit of a file": study.text("fit", "bare.csv", "--tip", "sphere 5 mm", "--out", "bare"),
        "fit by a pipeline": study.text(*page),
        "fit again": study.text("fit", "fits"),
        "repeat": study.text("repeat", "fits", "--by", "group"),
        "review": study.text("repeat", "review", "fits"),
        "methods": study.text("report", "fits", "--methods"),
        "page of a folder": study.page("screens.html", "fits"),
        "page of groups": study.page("groups.html", "fits", "--by", "group"),
        "page of a curve": study.page("curve.html", "page/ctrl_01").partition("Pipeline as")[0],
        "run": printed,
        "page of a run": words_of_page((folder / "words.html").read_text()).partition("Pipeline as")[0],
        "map": area[1] + area[2],
        "page of a map": words_of_page((area[0] / "area" / "report.html").read_text()).partition("Pipeline as")[0],
    }


def test_only_words_that_may_reach_a_screen_do(screens):
    for name, text in screens.items():
        assert not banned_phrases(text), name
        assert not unknown_heads(text), name
        assert not unknown_verdicts(text), name
    every = " ".join(screens.values())
    assert "unit of the force: N" in every
    assert all(re.search(rf"\b{word}\b", every) for word in ("good", "doubtful", "not determined"))
