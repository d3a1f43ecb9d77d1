"""A report draws the newest map of a run."""

import numpy as np
from palpate_kit.runs.run_folder import RunFolder
from palpate_report.figure_data import Curves
from palpate_report.run_contents import RunContents
from palpate_report.run_map import grid_of


def curves():
    time = np.arange(30.0)
    place, values = np.column_stack([time * 1e-3, 0 * time]), {"elasticity": 1e5 + 0 * time}
    return Curves("dr/ekf", time, place, time, time, time, values, values, time, np.ones(30, bool))


def test_the_newest_map_is_taken(tmp_path):
    record = RunContents(RunFolder(tmp_path))
    assert "latest estimate" in grid_of(record, curves(), "elasticity").caption
    maps = tmp_path / "maps"
    maps.mkdir()
    for number, value in (("", 1.0), ("-2", 2.0), ("-10", 10.0), ("-9", 9.0)):
        (maps / f"map{number}.csv").write_text(f"x_m,y_m,elasticity,elasticity_std\n0,0,{value},1\n1,0,{value},1\n")
        grid = grid_of(record, curves(), "elasticity")
        assert grid.value[0, 0] == max(value, 10.0 if number == "-9" else 0.0)
        assert grid.caption.startswith("map-10.csv" if number == "-9" else f"map{number}.csv")
    (maps / "map-11.csv").write_text("x_m,y_m,viscosity,viscosity_std\n0,0,5,1\n1,0,5,1\n")  # of another parameter
    (maps / "map-12.csv").write_text("x_m,y_m,elas")  # half a file
    assert grid_of(record, curves(), "elasticity").value[0, 0] == 10.0
