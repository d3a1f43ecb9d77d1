"""Folders of curves and tables of pandas fitted from Python."""

import numpy as np
import palpate
import pandas as pd
import pytest
from palpate import ConfigurationError, LogError

from tests.curves.conftest import press


@pytest.fixture(scope="module")
def curves(tmp_path_factory):
    folder = tmp_path_factory.mktemp("notebook") / "curves"
    folder.mkdir()
    for i in range(2):
        np.savetxt(
            folder / f"c{i}.csv",
            press(i, n=250),
            delimiter=",",
            header="time_s,force_N,height_mm",
            comments="",
            fmt="%.9g",
        )
    return folder


RIG = {"delay": "0 ms +- 1 ms", "thickness": "half-space", "tip_mass": "0 g", "tare": "none", "poisson": 0.5}


@pytest.mark.slow
def test_a_folder_is_a_table_with_units(curves, tmp_path):
    frame = palpate.fit_folder(curves, tip="paraboloid 3 mm", rig=RIG, out=tmp_path / "fits")
    assert list(frame.index) == [f"{curves}/c{i}.csv" for i in range(2)]
    written = pd.read_csv(tmp_path / "fits" / "fits.csv").set_index("curve")
    assert (frame["elasticity"] == written["elasticity"]).all()
    assert (frame["viscosity_combined"] == written["viscosity_combined"]).all()
    assert frame.attrs["units"]["elasticity_combined"] == "Pa"
    assert frame["used"].all()
    again = palpate.fit_folder(tmp_path / "fits", si=False)  # nothing is fitted again
    assert again.attrs["units"]["elasticity"] == "kPa"
    assert again["elasticity"].to_numpy() == pytest.approx(1e-3 * frame["elasticity"].to_numpy())
    assert "in Python" in (tmp_path / "fits" / "provenance.json").read_text()


@pytest.mark.slow
def test_a_table_and_a_path_are_fitted_as_the_file_is(curves):
    path = curves / "c0.csv"
    of_path = palpate.fit(path, tip="paraboloid 3 mm", rig=RIG)
    of_table = palpate.fit(pd.read_csv(path), tip="paraboloid 3 mm", rig=RIG)
    assert of_table.elasticity == of_path.elasticity
    plain = pd.read_csv(path).rename(columns={"time_s": "time", "force_N": "force", "height_mm": "height"})
    plain.attrs["units"] = {"time": "s", "force": "N", "height": "mm"}
    assert palpate.fit(plain, tip="paraboloid 3 mm", rig=RIG).elasticity == of_path.elasticity
    with pytest.raises(LogError, match=r"^table: no column can be the force"):
        palpate.fit(plain[["time", "height"]], tip="paraboloid 3 mm")


def test_what_is_no_record_is_named(curves, tmp_path):
    with pytest.raises(ConfigurationError, match="a list is not a record"):
        palpate.fit([1, 2], tip="paraboloid 3 mm")
    with pytest.raises(ConfigurationError, match="no such file or folder"):
        palpate.fit_folder(tmp_path / "nothing", tip="paraboloid 3 mm")
    with pytest.raises(ConfigurationError, match="no indenter 'spere'; did you mean 'sphere'"):
        palpate.fit_folder(curves, tip="spere 3 mm")
