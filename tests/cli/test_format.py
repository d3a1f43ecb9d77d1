"""Every table that is printed, as CSV or LaTeX, and nothing else on standard output."""

import csv
import re

import pytest

SHORT = ["--set", "trajectory.press.duration=2 s", "--set", 'run.tracks=["*/kinematic"]']


@pytest.fixture(scope="module")
def run(root, tmp_path_factory):
    from palpate_engine import load_pipeline, run_pipeline

    return run_pipeline(
        load_pipeline(root / "pipelines" / "filters.toml", SHORT[1::2]), tmp_path_factory.mktemp("f") / "r"
    ).folder


def rows_of(text):
    return list(csv.reader(line for line in text.splitlines() if line and not line.startswith("#")))


@pytest.mark.parametrize("command", ["repeat", "report budget", "repeat review", "replay"])
def test_csv_is_a_table_of_equal_rows(palpate, run, command):
    done = palpate(*command.split(), run, "--format", "csv")
    assert done.returncode == 0, done.stderr
    first = [line for line in done.stdout.split("\n\n")[0].splitlines() if not line.startswith("#")]
    rows = list(csv.reader(first))
    assert len(rows) > 1
    assert len({len(row) for row in rows}) == 1
    assert "±" not in done.stdout
    assert "┃" not in done.stdout


@pytest.mark.slow
def test_each_column_is_one_quantity_with_its_unit(palpate, run):
    done = palpate("replay", run, "--format", "csv")
    head, row = rows_of(done.stdout)[:2]
    assert head[:7] == [
        "track",
        "elasticity [kPa]",
        "u(elasticity) [kPa]",
        "elasticity verdict",
        "viscosity [Pa s]",
        "u(viscosity) [Pa s]",
        "viscosity verdict",
    ]
    assert [float(cell) for cell in row[1:7:3]] == pytest.approx([112.5, 362], rel=0.03)
    assert all(float(cell) > 0 for cell in row[2:7:3])
    assert "prediction [%]" in head or "force [%]" in head  # of several tracks, what compares them


def test_a_value_and_its_uncertainty_are_two_columns(palpate, run):
    done = palpate("repeat", run, run.parent / "r", "--details", "--format", "csv")
    head, row = rows_of(done.stdout)[:2]
    assert head[:5] == ["group", "runs", "mean [kPa]", "u(mean) [kPa]", "scatter [kPa]"]
    assert float(row[2]) == pytest.approx(112.5, rel=0.02)
    assert "runs:" in done.stderr  # the histogram is no table


@pytest.mark.parametrize("command", ["repeat", "report budget", "replay"])
def test_latex_is_whole(palpate, run, command):
    done = palpate(*command.split(), run, "--format", "latex")
    assert done.returncode == 0, done.stderr
    assert done.stdout.count(r"\begin{tabular}") == done.stdout.count(r"\end{tabular}") > 0
    body = [line for line in done.stdout.splitlines() if line.endswith(r"\\")]
    assert body
    for line in body:
        assert not re.search(r"(?<!\\)[%#_]", line), line
    assert "±" not in done.stdout


def test_the_next_command_prints_tables_again(palpate, run):
    palpate("repeat", run, "--format", "latex")
    assert "┃" in palpate("repeat", run).stdout
    refused = palpate("repeat", run, "--format", "xml")
    assert refused.returncode == 2
