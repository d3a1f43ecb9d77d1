"""An offline estimator of a stranger, with details of its own, beside a fit."""

import json

import pytest

PLUGIN = """
import numpy as np
from palpate import Estimates, Estimator, FitReport, Flag, FlagMeaning, Unknown, plugin
from dataclasses import replace
from pydantic import Field


class Constant(Estimator):
    '''Says the same of every record.'''

    online = False
    reports: bool = Field(default=False, description="whether it reports as a fit")
    fixed: str = Field(default="nothing", description="of another kind than the fit's")

    def start(self, problem):
        '''A tracker.'''
        return Always(self.reports)


class Always:
    def __init__(self, reports):
        self.reports = reports

    def run(self, samples):
        found = Estimates.idle(samples, 2)
        found.values[:], found.std[:], found.surface[:], found.surface_std[:] = (1e5, 3e2), (1e3, 3.0), 0.0, 1e-5
        found.force[:], found.status[:] = samples.force, 0
        details = {"fit": True, "unknowns": 3, "cycles": "many", "rss": np.float64(4.0), 7: np.ones(2)}
        report = FitReport(4.0, len(samples), {"elasticity": Unknown(1e5, "Pa", std=1e3)}) if self.reports else None
        return replace(found, details=details, flags=(Flag("own-trouble", "as always"),), report=report)


@plugin
def palpate_estimators():
    return {"constant": Constant}


@plugin
def palpate_flags():
    return {"own-trouble": FlagMeaning("note", "It is so.", "Nothing.")}
"""


@pytest.fixture
def beside(point_pipeline):
    """The pipeline with a fit, the stranger's estimator, and the same with a report."""
    (point_pipeline.parent / "own.py").write_text(PLUGIN)
    text = point_pipeline.read_text().replace("[run]\n", '[run]\nplugins = ["own.py"]\n', 1)
    own = '\n[estimator.fit]\ntype = "casadi-fit"\n[estimator.own]\ntype = "constant"\n'
    point_pipeline.write_text(text + own + '[estimator.says]\ntype = "constant"\nreports = true\n')
    return point_pipeline


def test_run_shows_it_and_keeps_its_details(palpate, beside, tmp_path):
    done = palpate("run", beside, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    tracks = json.loads((tmp_path / "out" / "result.json").read_text())["tracks"]
    assert "own-trouble" in {flag["code"] for flag in tracks["dr/own"]["flags"]}
    assert tracks["dr/own"]["details"]["unknowns"] == 3
    assert tracks["dr/own"]["details"]["7"] == [1.0, 1.0]
    assert "fit" not in tracks["dr/own"]
    assert tracks["dr/says"]["fit"]["unknowns"]["elasticity"]["std"] == 1e3
    assert tracks["dr/fit"]["fit"]["rss"] == tracks["dr/fit"]["details"]["rss"]
    assert tracks["dr/fit"]["fit"]["correlations"][0].keys() == {"first", "second", "value"}


@pytest.mark.slow
def test_commands_go_on_beside_it(palpate, beside, tmp_path):
    done = palpate("fit", "cycles", beside, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert [line for line in done.stdout.splitlines() if "dr/own" in line and "100" in line]
