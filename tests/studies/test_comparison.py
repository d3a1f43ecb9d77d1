"""What `palpate compare` shows of many tracks."""

import csv

import numpy as np
import pytest
from palpate import ConfigurationError
from palpate_kit.figures import common_limits


def test_one_curve_far_away_does_not_flatten_the_others():
    near = [np.full(50, 100.0), np.full(50, 104.0), np.full(50, 98.0)]
    low, high = common_limits([*near, np.full(50, 1e8)])
    assert 50 < low < 98
    assert 104 < high < 160
    assert common_limits([]) is None


@pytest.mark.slow
def test_tables_by_model_with_the_number_of_usable_tracks_and_a_csv(palpate, point_pipeline, tmp_path):
    short = ["--set", "trajectory.press.duration=2 s", "--set", 'run.tracks=["*"]']
    kinds = ["--models", "dr,kelvin-voigt", "--estimators", "ekf,kinematic-ekf"]
    done = palpate("compare", point_pipeline, *short, *kinds, "--out", "out", COLUMNS="100")
    assert done.returncode == 0, done.stderr
    assert "model dr" in done.stdout
    assert "model kelvin-voigt" in done.stdout
    assert "of 4 usable" in done.stdout
    assert "kinematic-ekf" in done.stdout  # never cut
    with (tmp_path / "out" / "compare.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {(row["model"], row["estimator"]) for row in rows} == {
        (model, estimator) for model in ("dr", "kelvin-voigt") for estimator in ("ekf", "kinematic-ekf")
    }
    truth = {row["parameter"]: row["truth"] for row in rows if row["model"] == "dr"}
    assert float(truth["elasticity"]) == 112.5e3


@pytest.mark.slow
def test_a_sweep_prints_its_best_rows(palpate, point_pipeline):
    text = point_pipeline.read_text() + '\n[sweep]\n"estimator.ekf.force_std" = ["0.05 N", "0.1 N"]\n'
    point_pipeline.write_text(text)
    short = ["--set", "trajectory.press.duration=1 s", "--set", 'run.tracks=["*/ekf"]']
    done = palpate("sweep", point_pipeline, *short, "--jobs", "1", "--out", "out")
    assert done.returncode == 0, done.stderr
    assert "best of 2 rows" in done.stdout
    assert "0.1 N" in done.stdout


OWN = '''
from palpate import ContactModel, Parameter, plugin

class Sticky(ContactModel):
    """A spring that pulls, and remembers more than it says."""
    adhesive = True
    memory = ("one", "two")
    parameters = (Parameter("elasticity", "E", "Pa", "a spring", role="elastic"),)

    def force(self, depth, rate, theta, memory=()):
        return theta[0] * depth * 1e-2 + memory[0]

    def memory_rate(self, depth, rate, theta, memory):
        return (rate - memory[0],)

@plugin
def palpate_models():
    return {"sticky": Sticky}
'''


@pytest.mark.slow
def test_what_lacks_a_key_or_does_not_start_leaves_the_others(point_pipeline):
    from palpate_engine import Source
    from palpate_studies.compare_command import _chosen
    from palpate_studies.tracks_that_run import with_what_runs

    def runs(*overrides):
        source, added = _chosen(Source.read(point_pipeline), "dr,jkr", "fit,ting-fit", ['run.tracks=["*"]', *overrides])
        return with_what_runs(source, added)

    point_pipeline.write_text(point_pipeline.read_text() + '\n[estimator.fit]\ntype = "casadi-fit"\n')
    pipeline, refused = runs()
    assert [str(track.name) for track in pipeline.tracks] == ["dr/fit", "dr/ting-fit"]
    assert set(refused) == {"jkr/fit", "jkr/ting-fit"}
    assert "radius: is missing" in refused["jkr/fit"]
    pipeline, refused = runs("estimator.fit.fixed={ surface = 0.0 }", 'estimator.fit.contact_point="gradient"')
    assert [str(track.name) for track in pipeline.tracks] == ["dr/ting-fit"]
    assert "neither fixed nor bounded" in refused["dr/fit"]
    with pytest.raises(ConfigurationError, match="thikness"):  # what the file itself says wrong stays a mistake
        runs('model.dr.thikness="2 mm"')


@pytest.mark.slow
def test_what_cannot_run_is_a_row_with_the_reason(palpate, point_pipeline, tmp_path):
    """A model that lacks its radius, and one of the user's own that is wrong: the others have their rows."""
    (point_pipeline.parent / "own.py").write_text(OWN)
    point_pipeline.write_text(point_pipeline.read_text() + '\n[model.sticky]\ntype = "sticky"\n')
    short = ["--set", "trajectory.press.duration=1 s", "--set", 'run.tracks=["*"]', "--set", 'run.plugins=["own.py"]']
    kinds = ["--models", "dr,jkr,sticky", "--estimators", "kinematic"]
    done = palpate("compare", point_pipeline, *short, *kinds, "--out", "out")
    assert done.returncode == 0, done.stderr
    with (tmp_path / "out" / "compare.csv").open(newline="") as file:
        rows = {row["model"]: row for row in csv.DictReader(file) if row["parameter"] in ("", "elasticity")}
    assert rows["dr"]["verdict"] != "not run"
    assert float(rows["dr"]["value"]) > 0
    assert "radius: is missing" in rows["jkr"]["flags"]
    assert rows["sticky"]["verdict"] in ("not run", "invalid")
    assert rows["sticky"]["flags"]
    assert "of 3 usable" in done.stdout


def test_a_name_that_no_model_has_is_still_a_mistake(palpate, point_pipeline):
    done = palpate("compare", point_pipeline, "--models", "dr,maxwel", "--estimators", "ekf")
    assert done.returncode == 2
    assert "maxwell" in done.stderr
