"""Which tests spend the time: `python .ci/test_times.py REPORT.xml...` of reports by `pytest --junitxml`.

Prints the seconds of every family and of the tests that take most, each with its share of the whole. A test's seconds
hold the fixtures that are made for it.
"""

import sys
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

MOST = 25  # tests that are listed


def seconds_of(report: Path) -> Counter[str]:
    """Return the seconds [s] of each test of a report, by its file and name."""
    seconds = Counter[str]()
    for case in ElementTree.parse(report).iter("testcase"):
        place = case.get("classname", "").removeprefix("tests.").replace(".", "/")
        seconds[f"{place}::{case.get('name')}"] += float(case.get("time", 0.0))
    return seconds


def table(seconds: Counter[str], most: int | None = None) -> list[str]:
    """Return a line of each that takes most: seconds [s], share of the whole, name."""
    whole = max(seconds.total(), 1e-9)
    return [f"{value:8.1f} s {100 * value / whole:5.1f} %  {name}" for name, value in seconds.most_common(most)]


def main(reports: list[str]) -> None:
    """Print both tables."""
    tests = Counter[str]()
    for report in reports:
        tests += seconds_of(Path(report))
    families = Counter[str]()
    for name, value in tests.items():
        families[name.partition("::")[0].partition("/")[0]] += value
    print(f"{tests.total():.0f} s of {len(tests)} tests; families:", *table(families), sep="\n")
    print("tests that take most:", *table(tests, MOST), sep="\n")


if __name__ == "__main__":
    main(sys.argv[1:])
