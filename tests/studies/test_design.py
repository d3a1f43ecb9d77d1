"""`palpate plan design`: a table, a picture and a recommendation."""

import json
import math

import pytest


@pytest.fixture
def file(root):
    """An example pipeline."""
    return root / "pipelines" / "late.toml"


@pytest.mark.gate
@pytest.mark.slow
def test_table_and_recommendation(palpate, file):
    done = palpate(
        "check", "motion", "design", file, "--set", 'design.parameters={elasticity="282.1 kPa", viscosity="860 Pa*s"}'
    )
    assert done.returncode == 0, done.stderr
    row = next(
        line
        for line in done.stdout.splitlines()
        if (line.startswith("│ 2 ") and "│        1 │" in line) or " 0.795 │" in line
    )
    for text in ("0.0562", "0.282", "-0.0093"):
        assert text in row
    assert "recommended within the limits: 5 Hz, 1.5 mm" in " ".join(done.stdout.split())


@pytest.mark.slow
def test_the_truth_of_a_simulated_rig_is_what_is_expected(palpate, file):
    done = palpate("check", "motion", "design", file)
    assert "elasticity 1.125e+05 Pa, viscosity 362 Pa*s" in done.stdout


@pytest.mark.slow
def test_json_has_every_bound(palpate, file):
    done = palpate("check", "motion", "design", file, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["dr"]
    assert found["expected"] == {"elasticity": 112.5e3, "viscosity": 362.0}
    assert len(found["palpations"]) == 15
    (best,) = [row for row in found["palpations"] if row["recommended"]]
    assert best["bounds"]["known"]["elasticity"] < best["bounds"]["unknown both"]["elasticity"]
    assert best["bias"]["elasticity"] < 0


@pytest.mark.slow
def test_limits_move_the_recommendation(palpate, file):
    done = palpate(
        "check",
        "motion",
        "design",
        file,
        "--set",
        "design.top_acceleration=0.1",
        "--set",
        "design.multisines=[[0.5, 2.0]]",
    )
    assert done.returncode == 0, done.stderr
    assert "0.5 + 2" in done.stdout
    assert "m/s^2" in done.stdout
    done = palpate("check", "motion", "design", file, "--set", "design.top_speed=1e-9")
    assert "no setting keeps the limits" in done.stdout


RELAXING = '\n[model.sls]\ntype = "standard-linear-solid"\nindenter = "tip"\n'


@pytest.mark.slow
def test_a_model_that_remembers_is_left_out_with_advice(palpate, file, tmp_path):
    both = tmp_path / "both.toml"
    both.write_text(file.read_text() + RELAXING)
    done = palpate("check", "motion", "design", both)
    assert done.returncode == 0, done.stderr
    assert "left out: sls: this model remembers" in done.stdout
    assert "dr: recommended" in " ".join(done.stdout.split())
    text = file.read_text()
    begin, end = text.index("[model.dr]"), text.index("[estimator.ekf]")
    inline = 'model = { type = "dimensionality-reduction", indenter = "tip" }'
    both.write_text((text[:begin] + text[end:] + RELAXING).replace('model = "dr"', inline))
    done = palpate("check", "motion", "design", both)
    assert done.returncode == 2
    assert "Design for dimensionality-reduction" in " ".join(done.stderr.split())


SAFETY = """
[safety]
low = ["-5 mm", "-5 mm", "-5 mm"]
high = ["5 mm", "5 mm", "60 mm"]
speed = "40 mm/s"
acceleration = "0.5 m/s^2"
stop_force = "12 N"
force = "20 N"
stiffness = "3 N/mm"
"""


@pytest.mark.slow
def test_the_robots_own_limits_count(palpate, file, tmp_path):
    """5 Hz and 1.5 mm, which would be best, are 1.5 m/s^2 and 5.5 mm deep."""
    bound = tmp_path / "bound.toml"
    bound.write_text(file.read_text() + SAFETY)
    done = palpate("check", "motion", "design", bound)
    assert done.returncode == 0, done.stderr
    words = " ".join(done.stdout.split()).partition("recommended within the limits: ")[2].split()
    frequency, amplitude = float(words[0]), float(words[2])
    assert (2 * math.pi * frequency) ** 2 * amplitude * 1e-3 <= 0.5
    assert 2 * math.pi * frequency * amplitude <= 40
    assert amplitude < 1.5


@pytest.mark.slow
def test_the_picture(palpate, file, tmp_path):
    pytest.importorskip("matplotlib")
    few = ("--set", "design.frequencies=[1.0, 2.0]", "--set", 'design.amplitudes=["1 mm"]')
    done = palpate("check", "motion", "design", file, *few, "--picture", tmp_path / "bounds.png")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "bounds.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "words"), [(".", "ends in .png"), ("no/such/bounds.png", "cannot write")])
def test_a_picture_that_cannot_be_written_is_one_message(palpate, file, name, words):
    few = ("--set", "design.frequencies=[1.0]", "--set", 'design.amplitudes=["1 mm"]')
    done = palpate("check", "motion", "design", file, *few, "--picture", name)
    assert done.returncode == 2
    assert words in done.stderr


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("design.frequencies=[0.0]", "must be positive"),
        ('design.parameters={elasticity="5 mm"}', "is a length"),
        ("design.amplitude=1", "did you mean 'amplitudes'"),
        ("design.rate=1 mm", "is a length"),
    ],
)
def test_mistakes_are_told(palpate, file, override, message):
    done = palpate("check", "motion", "design", file, "--set", override)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
