"""The table that compares tracks: what a narrow screen keeps, what a file has, and the row of a track that failed."""

import csv
import io

import pytest
from palpate_engine import TrackComparison
from palpate_kit.terminal.comparison_table import comparison_table, lines_below, reason_of
from palpate_kit.terminal.layout import text_of
from palpate_kit.terminal.result_table import ResultFinding, ResultRow, ResultTable, TableValue, TrackMeasures
from palpate_kit.terminal.table import console


def measures(nis=1.0, cost=1e-6, duration=10.0):
    comparison = TrackComparison(
        0.05, 5.0, 4000, 4000, (0.9, 1.1), {"elasticity": 0.5}, {"elasticity": 0.4, "viscosity": -3.0}
    )
    return TrackMeasures.of(comparison, nis, cost, 5000, duration)


def row(track, verdict="good", findings=(), **measured):
    is_lost = verdict == "invalid"
    values = {
        name: TableValue(name, None if is_lost else size, size / 50, unit, verdict)
        for name, size, unit in (("elasticity", 112.5e3, "Pa"), ("viscosity", 362.0, "Pa*s"), ("power", 0.2, "1"))
    }
    return ResultRow("", track, values, findings=findings, measures=measures(**measured))


FAILED = ResultFinding("failed", "invalid", (), {}, "estimator 'mine' failed: ValueError: no", "")


def shown(table, width, capsys):
    console(width).print(comparison_table(table).view())
    return capsys.readouterr().out


def test_eighty_columns_show_values_prediction_nis_and_time_to_settle(capsys):
    table = ResultTable((row("dr/ekf", nis=1.3), row("dr/kinematic")), {"elasticity": 112.5e3})
    text = shown(table, 80, capsys)
    assert max(map(len, text.splitlines())) <= 80
    assert "112.5 ± 2.2  good" in " ".join(text.split("\n"))
    assert all(word in text for word in ("force", "NIS", "settled", "1.30 >", "truth"))
    assert "off" not in text
    wide = shown(table, 120, capsys)
    assert all(word in wide for word in ("cost", "E off", "+0.4", "-3.0"))


def test_a_file_has_every_column_and_every_value(capsys):
    table = comparison_table(ResultTable((row("dr/ekf"), row("dr/mine", "invalid", (FAILED,)))), is_whole=True)
    first, second = csv.DictReader(io.StringIO(text_of(table.view(), "csv")))
    assert first["elasticity [kPa]"] == "112.5"
    assert float(first["power 1"]) == 0.2
    assert (first["force [%]"], first["NIS low"], first["cost [us]"], first["samples"]) == ("1", "0.90", "1", "5000")
    assert first["viscosity off [u]"] == "-3.0"
    assert (first["reason"], second["reason"]) == ("", "failed")


def test_a_track_that_failed_has_the_reason_in_place_of_its_value(capsys):
    table = ResultTable((row("dr/ekf"), row("dr/mine", "invalid", (FAILED,))))
    line = next(line for line in shown(table, 80, capsys).splitlines() if line.startswith("dr/mine"))
    assert line.split()[:3] == ["dr/mine", "failed", "invalid"]


@pytest.mark.parametrize(("cost", "is_slow"), [(1e-6, False), (3e-3, True)])
def test_a_track_that_is_slower_than_its_sensors_is_named(cost, is_slow):
    slow = row("dr/slow", cost=cost)
    text = " ".join(lines_below(ResultTable((slow, row("dr/ekf")))))
    assert ("dr/slow is slower than real time" in text) == is_slow
    assert ("slower than real time" in reason_of(slow)) == is_slow
