"""``palpate model force``."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest
from palpate.errors import PalpateError
from palpate_models import force_command
from typer import Typer
from typer.testing import CliRunner

SPHERE = ["--model", "dimensionality-reduction", "--indenter", "sphere", "--set", "indenter.radius=5 mm"]
VALUES = ["--parameter", "elasticity=112 kPa", "--parameter", "viscosity=362 Pa*s"]


def force(*arguments):
    app = Typer(pretty_exceptions_enable=False)
    app.command()(force_command.force)
    return CliRunner().invoke(app, [*map(str, arguments)])


def table(text):
    rows = list(csv.reader(io.StringIO(text)))
    return rows[0], np.array(rows[1:], float)


def test_a_ramp_is_the_papers_formula():
    result = force(*SPHERE, *VALUES, "--depth", "2 mm", "--speed", "4 mm/s")
    assert result.exit_code == 0, result.output
    heading, rows = table(result.stdout)
    assert heading == ["time [s]", "depth [m]", "rate [m/s]", "force [N]"]
    time, depth, rate, found = rows.T
    assert time[-1] == pytest.approx(0.5)
    assert depth[-1] == pytest.approx(2e-3)
    expected = 4 / 3 * 112e3 / 0.75 * np.sqrt(5e-3) * depth**1.5 + 8 * 362 * np.sqrt(5e-3 * depth) * rate
    np.testing.assert_allclose(found[1:], expected[1:], rtol=1e-7)
    assert found[0] == 0


@pytest.mark.slow
def test_a_sine_goes_to_a_file_and_a_picture(tmp_path):
    out, picture = tmp_path / "f.csv", tmp_path / "f.svg"
    result = force(*SPHERE, *VALUES, "--frequency", "2 Hz", "--cycles", 2, "-o", out, "--picture", picture)
    assert result.exit_code == 0, result.output
    _, rows = table(out.read_text())
    time, depth, rate, _ = rows.T
    assert time[-1] == pytest.approx(1.5)
    assert depth.max() == pytest.approx(4e-3, rel=1e-3)
    np.testing.assert_allclose(np.gradient(depth, time)[1:-1], rate[1:-1], atol=5e-3 * rate.max())
    assert picture.read_text().startswith("<?xml")


def test_a_material_that_does_not_stick_never_pulls():
    result = force("--model", "maxwell", "--indenter", "flat", "--set", "indenter.radius=3 mm", "--frequency", "2 Hz")
    assert result.exit_code == 0, result.output
    assert "elasticity not given: 50000 Pa" in result.stderr
    _, rows = table(result.stdout)
    assert rows[:, 3].min() == 0
    assert rows[:, 3].max() > 0


def test_a_model_of_a_pipeline(tmp_path):
    path = tmp_path / "p.toml"
    path.write_text(
        '[indenter.tip]\ntype = "cone"\nangle = "30 deg"\n[model.a]\ntype = "dimensionality-reduction"\n'
        'indenter = "tip"\n[model.b]\ntype = "kelvin-voigt"\n'
    )
    result = force(path, "--model", "b", "--parameter", "stiffness=1 N/mm", "--parameter", "damping=0")
    _, rows = table(result.stdout)
    np.testing.assert_allclose(rows[:, 3], 1e3 * rows[:, 1], rtol=1e-7)
    steep = force(path, "--model", "a", *VALUES, "--set", "indenter.tip.angle=60 deg")
    flat = force(path, "--model", "a", *VALUES)
    assert table(flat.stdout)[1][-1, 3] == pytest.approx(3 * table(steep.stdout)[1][-1, 3], rel=1e-6)


def test_a_correction_out_of_range_is_said():
    thick = ["--set", 'model.thickness={ law = "dimitriadis", height = "10 mm" }']
    assert "the depth is 30% of the layer's height" in force(*SPHERE, *VALUES, *thick).stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--indenter", "spere"], "did you mean 'sphere'"),
        (["--indenter", "sphere"], r"\[indenter.tip\] radius: is missing"),
        (["--model", "kelvin"], "there is no model 'kelvin'"),
        (["--model", "compression", "--indenter", "flat"], "takes no indenter"),
        ([*SPHERE, "--parameter", "elastic=1"], "did you mean 'elasticity'"),
        ([*SPHERE, "--parameter", "elasticity=5 mm"], "is a length, not a pressure"),
        ([*SPHERE, "--parameter", "elasticity=-5"], "allowed is 0 to inf Pa"),
        ([*SPHERE, "--depth", "0 mm"], "must be more than 0"),
        ([*SPHERE, "--speed", "4 kPa"], "is a pressure, not a speed"),
        ([*SPHERE, "--set", "radius=5 mm"], r"write model.KEY=VALUE or indenter.KEY=VALUE"),
        ([*SPHERE, "-o", "/no/such/folder/f.csv"], "cannot write"),
        ([*SPHERE, "--picture", "/no/such/folder/f.png"], "cannot write"),
        ([*SPHERE, "--picture", "f.what"], "a picture's name ends in"),
        (["no.toml"], "cannot read the pipeline file"),
    ],
)
def test_a_mistake_is_one_message(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = force(*arguments)
    assert isinstance(result.exception, PalpateError)
    assert result.exception.exit_code == 2
    with pytest.raises(PalpateError, match=words):
        raise result.exception
