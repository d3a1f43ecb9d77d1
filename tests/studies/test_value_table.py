"""`palpate repeat --table`: every value of runs and fits, a row each, over folders of years."""

import csv
import json

import pytest

from tests import result_documents
from tests.fit_tables import draw_animals

_PIPELINE = """[device.arm]
type = "ur3e"

[indenter.ball]
type = "sphere"
radius = 0.005

[model.dr]
type = "dimensionality-reduction"
indenter = "ball"
"""


def write_run(folder, value=1e5, name="liver 3", started="2025-03-01T10:00:00+00:00", **more):
    """A run folder with one value, of a sphere of 5 mm on a UR3e."""
    found = result_documents.value(value, combined=2e3, verdict="good")
    told = [{"fact": "poisson", "message": "nu 0.5", "remedy": "--poisson", "alternative": "0.45"}]
    track = result_documents.track(parameters={"elasticity": found}, conditions=told, **more)
    document = result_documents.result({"dr/ekf": track})
    document["run"] |= {"name": name, "started": started, "inputs": {"arm.serial_number": "2023-7"}}
    folder.mkdir(parents=True)
    (folder / "result.json").write_text(json.dumps(document))
    (folder / "pipeline.toml").write_text(_PIPELINE)


@pytest.fixture
def years(tmp_path):
    """Runs and fits of two years."""
    write_run(tmp_path / "years" / "2024" / "run_10")
    write_run(tmp_path / "years" / "2024" / "run_2", 2e5, "=liver")
    draw_animals(tmp_path / "years" / "2025" / "fits", animals=2, curves=3)
    return tmp_path / "years"


def rows_in(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_a_row_has_a_value_with_what_it_holds_for(palpate, years):
    done = palpate("repeat", "years", "--table", "all.csv")
    assert done.returncode == 0, done.stderr
    assert done.stdout == "all.csv: 14 values of 3 records\n"
    rows = rows_in(years.parent / "all.csv")
    assert [row["record"] for row in rows[:3]] == ["years/2024/run_2", "years/2024/run_10", "years/2025/fits"]
    run, curve = rows[1], rows[2]
    assert (float(run["value"]), float(run["combined"]), run["unit"]) == (1e5, 2e3, "Pa")
    assert run["tip"] == "sphere, radius 5 mm (diameter 10 mm)"
    assert (run["rig"], run["specimen"], run["date"]) == ("arm: ur3e 2023-7", "liver 3", "2025-03-01T10:00:00+00:00")
    assert (run["verdict"], run["conditions"]) == ("good", "poisson: nu 0.5")
    assert (curve["curve"], curve["animal"], curve["treatment"]) == ("curves/0-0-0.csv", "0-0", "t0")
    assert curve["tip"] == "sphere, radius 3 mm (diameter 6 mm)"


def test_facts_of_a_curve_are_those_of_its_row(palpate, years):
    path = years / "2025" / "fits" / "curves.csv"
    lines = path.read_text().splitlines()
    more = ["tip,sample,date", *["sphere 1 mm,S1,2025-04-02"] * (len(lines) - 1)]
    path.write_text("".join(f"{line},{end}\n" for line, end in zip(lines, more, strict=True)))
    palpate("repeat", "years", "--table", "all.csv")
    row = rows_in(years.parent / "all.csv")[-1]
    assert "radius 1 mm" in row["tip"]  # in the words of every other tip
    assert (row["specimen"], row["date"]) == ("S1", "2025-04-02")


def test_a_tip_of_curves_alone_is_theirs(palpate, years):
    """A tip of `curves.csv` stands in the table of a model that has none for all, and the command broke off."""
    fits = years / "2025" / "fits"
    pipeline = (fits / "pipeline.toml").read_text()
    for line in ('indenter = "tip"', 'type = "dimensionality-reduction"'):
        assert line in pipeline
    pipeline = pipeline.replace('indenter = "tip"\n', "")
    pipeline = pipeline.replace('type = "dimensionality-reduction"', 'type = "kelvin-voigt"')
    (fits / "pipeline.toml").write_text(pipeline)
    lines = (fits / "curves.csv").read_text().splitlines()
    ends = ["tip", "sphere 1 mm", *[""] * (len(lines) - 2)]
    (fits / "curves.csv").write_text("".join(f"{line},{end}\n" for line, end in zip(lines, ends, strict=True)))
    done = palpate("repeat", "years", "--table", "all.csv")
    assert done.returncode == 0, done.stderr
    tips = [row["tip"] for row in rows_in(years.parent / "all.csv") if row["record"].endswith("fits")]
    assert ["radius 1 mm" in tip for tip in tips] == [True, *[False] * (len(tips) - 1)]


def test_what_was_rejected_says_why(palpate, years):
    palpate("repeat", "review", "years/2024/run_2", "--reject", "run_2", "--reason", "slipped")
    palpate("repeat", "years", "--table", "all.csv", "--track", "dr/ekf")
    assert [row["rejected"] for row in rows_in(years.parent / "all.csv")] == ["slipped", ""]


@pytest.mark.slow
def test_a_workbook_has_the_same_cells_and_no_formula(palpate, years):
    openpyxl = pytest.importorskip("openpyxl")
    for name in ("all.csv", "all.xlsx", "again.xlsx"):
        assert palpate("repeat", "years", "--table", name).returncode == 0
    sheet = openpyxl.load_workbook(years.parent / "all.xlsx").active
    cells = list(sheet.iter_rows(values_only=True))
    rows = rows_in(years.parent / "all.csv")
    assert list(cells[0]) == list(rows[0])
    assert len(cells) == len(rows) + 1
    value, specimen = cells[0].index("value"), cells[0].index("specimen")
    assert [row[value] for row in cells[1:]] == pytest.approx([float(row["value"]) for row in rows], rel=1e-14)
    assert cells[1][specimen] == "=liver"
    assert sheet.cell(2, specimen + 1).data_type == "s"
    assert (years.parent / "all.xlsx").read_bytes() == (years.parent / "again.xlsx").read_bytes()


@pytest.mark.slow
def test_parquet_has_numbers_and_texts(palpate, years):
    parquet = pytest.importorskip("pyarrow.parquet")
    for name in ("all.csv", "all.parquet"):
        assert palpate("repeat", "years", "--table", name).returncode == 0
    found = parquet.read_table(years.parent / "all.parquet").to_pydict()
    rows = rows_in(years.parent / "all.csv")
    assert found["value"] == [float(row["value"]) for row in rows]
    assert found["animal"] == [row["animal"] for row in rows]


def test_a_value_that_was_not_determined_is_open(palpate, tmp_path):
    nothing = {"value": None, "std": None, "unit": "Pa", "settling": None, "combined": None}
    write_run(tmp_path / "run")
    document = json.loads((tmp_path / "run" / "result.json").read_text())
    document["tracks"]["dr/ekf"]["parameters"]["elasticity"] = {**nothing, "verdict": "not determined"}
    (tmp_path / "run" / "result.json").write_text(json.dumps(document))
    palpate("repeat", "run", "--table", "all.csv")
    (row,) = rows_in(tmp_path / "all.csv")
    assert (row["value"], row["verdict"]) == ("", "not determined")


def test_a_damaged_run_is_left_out_by_name(palpate, years):
    (years / "2024" / "run_2" / "result.json").write_text("{")
    done = palpate("repeat", "years", "--table", "all.csv")
    assert done.returncode == 1
    assert "years/2024/run_2 is left out" in done.stderr
    assert len(rows_in(years.parent / "all.csv")) == 13


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["years", "--table", "all.txt"], "--table all.txt: a table's name ends in .csv, .parquet, .xlsx"),
        (["--table", "all.csv"], "name at least one folder of runs"),
        (["nothing", "--table", "all.csv"], "nothing"),
        (["years", "--table", "all.csv", "--by", "animal"], "--by is for statistics"),
        (["years", "--table", "all.csv", "--parameter", "elastcity"], "did you mean 'elasticity'"),
        (["years/2024", "--table", "all.csv", "--where", "animal=1"], "is not a folder of fits"),
    ],
)
def test_mistakes_of_a_table_are_named(palpate, years, words, message):
    done = palpate("repeat", *words)
    assert done.returncode == 2
    assert message in " ".join(done.stderr.split())
    assert not (years.parent / "all.csv").exists()


@pytest.mark.parametrize(("module", "name"), [("openpyxl", "all.xlsx"), ("pyarrow", "all.parquet")])
def test_a_library_that_is_missing_is_named(palpate, years, monkeypatch, module, name):
    monkeypatch.setitem(__import__("sys").modules, module, None)
    done = palpate("repeat", "years", "--table", name)
    assert done.returncode == 2
    assert f"{name}: needs {module}" in done.stderr
    assert list(years.parent.glob("*all.*")) == []
