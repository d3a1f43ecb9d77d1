"""A workbook of several specimens: a row for each sheet, and sheets without a record are named."""

import json

import numpy as np
import pytest

pytest.importorskip("openpyxl")


def workbook(path, sheets, results=False):
    """Presses of 3 mm spheres on half-spaces, elasticity [kPa] by sheet, and a sheet of results before them."""
    from openpyxl import Workbook

    book = Workbook()
    book.remove(book.active)
    if results:
        sheet = book.create_sheet("Results")
        for row in (["specimen", "kPa"], *([k, 1.5 * k] for k in range(1, 5))):
            sheet.append(row)
    time = np.arange(300) / 100.0
    height = 1e-3 - 1e-3 * np.clip(time - 0.7, 0.0, 2.0)
    for name, elasticity in sheets.items():
        sheet = book.create_sheet(name)
        sheet.append(["time (s)", "height (mm)", "force (N)"])
        force = 16 / 9 * 1e3 * elasticity * np.sqrt(3e-3) * np.maximum(-height, 0.0) ** 1.5
        force += 2e-3 * np.random.default_rng(0).standard_normal(len(time))
        for row in zip(time.tolist(), (1e3 * height).tolist(), force.tolist()):
            sheet.append(row)
    book.save(path)


@pytest.mark.slow
@pytest.mark.parametrize("results", [False, True])
def test_each_sheet_is_a_row(palpate, tmp_path, monkeypatch, results):
    """The first sheet was fitted, and all was well; a sheet of results before it was asked for its rate."""
    monkeypatch.chdir(tmp_path)
    workbook(tmp_path / "gels.xlsx", {"soft": 30.0, "stiff": 90.0}, results)
    told = palpate("fit", "gels.xlsx", "--tip", "paraboloid 3 mm", "--json")
    rows = json.loads(told.stdout)["files"]
    assert [row["curve"] for row in rows] == ["gels.xlsx:soft", "gels.xlsx:stiff"]
    found = [next(float(v) for k, v in row.items() if k.endswith("elasticity")) for row in rows]
    np.testing.assert_allclose(found, [30e3, 90e3], rtol=0.02)
    assert ("gels.xlsx:Results is not a record" in told.stderr) == results
    assert palpate("fit", "gels.xlsx", "--tip", "paraboloid 3 mm", "--set", "device.log.sheet=stiff").returncode == 0


def test_the_sheets_of_a_workbook_are_specimens(tmp_path):
    from palpate_engine import registry
    from palpate_kit.curves.alike_logs import specimens_of

    known = registry.load()
    workbook(tmp_path / "gels.xlsx", {"soft": 30.0, "stiff": 90.0})
    assert [part.name for part in specimens_of(tmp_path / "gels.xlsx", known)] == ["gels.xlsx:soft", "gels.xlsx:stiff"]
    workbook(tmp_path / "one.xlsx", {"soft": 30.0})
    assert [part.name for part in specimens_of(tmp_path / "one.xlsx", known)] == ["one.xlsx"]
