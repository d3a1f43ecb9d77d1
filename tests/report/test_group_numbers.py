"""The mean of a group of runs carries what the runs have in common."""

from types import SimpleNamespace

from palpate_report.comparison_report import _statistics
from palpate_report.group_numbers import common_of, compare_runs


def run(value, systematic=2e3, verdict="good", of_value="good"):
    numbers = {"value": value, "std": 100.0, "combined": 2.1e3, "systematic": systematic, "unit": "Pa"}
    numbers["verdict"] = of_value
    tracks = {"dr/fit": {"verdict": verdict, "parameters": {"elasticity": numbers}}}
    return SimpleNamespace(name="run", group="soft", tracks=tracks, cells=None)


def test_the_mean_of_runs_carries_their_common_part():
    runs = [run(112e3), run(112.4e3), run(111.6e3), run(112e3), run(50e3, 9e3, "invalid"), run(0.6, of_value="invalid")]
    assert set(common_of(runs, "soft", "dr/fit", "elasticity")) == {2e3}
    comparison = compare_runs(runs, ["soft"], "dr/fit", "elasticity")
    row = _statistics(runs, comparison, "soft", "dr/fit", "elasticity", "Pa")
    assert row["mean"] == "112.0 ± 2.0"  # scatter alone: 0.16
    assert (row["count"], row["unit"]) == (4, "kPa")
    assert not len(common_of([run(1.0, None)], "soft", "dr/fit", "elasticity"))
