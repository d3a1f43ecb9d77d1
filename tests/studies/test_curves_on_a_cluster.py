"""``palpate fit --each`` on the workers of a scheduler: the table of this machine."""

import csv

import numpy as np
import pytest

distributed = pytest.importorskip("distributed")
import dask  # noqa: E402

from tests.fits.test_fit_each import DEADLY, EACH, PIPELINE, curve, folder  # noqa: E402, F401

pytestmark = pytest.mark.filterwarnings("ignore")  # of dask's own, when workers die


@pytest.fixture(scope="module")
def scheduler():
    """Two workers on this machine; a task that has killed two of them is given up."""
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 1}),
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50) as running,
    ):
        yield running.scheduler_address


@pytest.mark.slow
def test_many_curves_make_the_table_of_this_machine(scheduler, palpate, folder):  # noqa: F811
    assert palpate(*EACH, "--jobs", "1").returncode == 1
    there = [*EACH[:-1], "there", "--scheduler", scheduler]
    done = palpate(*there)
    assert done.returncode == 1
    assert "1 fits of 5 failed" in done.stderr
    table = (folder / "there" / "fits.csv").read_bytes()
    assert table == (folder / "out" / "fits.csv").read_bytes()
    assert palpate(*there).returncode == 1
    assert (folder / "there" / "fits.csv").read_bytes() == table  # every curve has its row
    for more in (("--jobs", "2"), ("--by", "curve"), ("--stage", "s3://bucket/a")):
        refused = palpate(*there, *more)
        assert refused.returncode == 2
        assert more[0] in refused.stderr


@pytest.mark.slow
def test_a_curve_that_kills_its_workers_costs_its_own_row_only(scheduler, palpate, folder):  # noqa: F811
    np.savetxt("curves/2.csv", curve(1e5, 2, speed=20e-3), delimiter=",")  # short
    (folder / "deadly.py").write_text(DEADLY)
    text = PIPELINE.replace("PLUGINS", 'plugins = ["deadly.py"]').replace("MORE", "")
    (folder / "reader.toml").write_text(text.replace('type = "casadi-fit"\nsegment = "cycle"', 'type = "deadly"'))
    palpate(*EACH, "--scheduler", scheduler)
    with (folder / "out" / "fits.csv").open(newline="") as file:
        errors = {row["curve"]: row["error"] for row in csv.DictReader(file)}
    assert list(errors) == ["0.csv", "1.csv", "2.csv", "3.csv", "deeper/4.csv"]
    assert [name for name, error in errors.items() if "killed several times: is the memory enough?" in error] == [
        "2.csv"
    ]
