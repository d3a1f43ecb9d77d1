"""`palpate fit choose`: the model of the truth is chosen, another is not, and what cannot be is said."""

import json

import numpy as np
import pytest
from palpate_uncertainty.model_standings import Candidate, rank_models, sentence

PIPELINE = """
[run]
seed = {seed}
[device.rig]
type = "sim"
tip_mass = "140 g"
[device.rig.specimen]
model = "{truth}"
{values}
surface = "0.2 mm"
[trajectory.press]
type = "multi-sine"
bias = "3 mm"
amplitudes = ["0.6 mm", "0.4 mm"]
frequencies = ["0.7 Hz", "4 Hz"]
duration = "4 s"
[alignment]
force = {{ channel = "rig.wrench.z", uncertainty = "0.1 ms" }}
position = {{ channel = "rig.tip.z", uncertainty = "0.1 ms" }}
measuring = "rig.setpoint.measuring"
tip_mass = "140 g"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
[model.sls]
type = "standard-linear-solid"
indenter = "tip"
[model.kv]
type = "kelvin-voigt"
[estimator.fit]
type = "casadi-fit"
"""
DAMPED = 'elasticity = "100 kPa"\nviscosity = "400 Pa*s"'
RELAXING = 'elasticity = "100 kPa"\nrelaxing_elasticity = "50 kPa"\nrelaxation_time = "80 ms"'


@pytest.mark.slow
@pytest.mark.parametrize(
    ("truth", "values", "others"),
    [("dr", DAMPED, "dr,kv"), pytest.param("sls", RELAXING, "dr,sls", marks=pytest.mark.slow)],
)
def test_the_truth_is_chosen(palpate, tmp_path, truth, values, others):
    (tmp_path / "p.toml").write_text(PIPELINE.format(truth=truth, values=values, seed=2))
    done = palpate("fit", "choose", tmp_path / "p.toml", "--models", others, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    first, second = found["standings"]
    assert first["model"] == truth
    assert second["behind"] > 6
    assert first["best_blocks"] >= 3
    wrong = next(one for one in found["candidates"] if one["model"] == second["model"])
    assert wrong["lack_of_fit"]
    assert first["held_out"] == pytest.approx(0.045, rel=0.15)  # the sensor's noise between two readings
    assert found["sentence"].startswith(f"The data of the record support {truth} (weight 100 %)")


def made(model, evidence, misfit=False, record="one", blocks=(0.05, 0.05, 0.05, 0.05)):
    return Candidate(record, model, evidence, 1.0, np.array(blocks), 0.05, misfit, "good", (1e5, 1e3))


def test_records_add_their_evidence_and_a_tie_is_told_as_one():
    two = [made(m, e, record=r) for m, e, r in (("a", 0, "1"), ("b", 4, "1"), ("a", 0, "2"), ("b", 4, "2"))]
    first, second = rank_models(two)
    assert (first.model, second.behind) == ("a", 8.0)
    assert first.weight == pytest.approx(1 / (1 + np.exp(-4)))
    assert "support a (weight 98 %); less b by 8 of BIC" in sentence([first, second], 2)
    assert "support a and b alike" in sentence(rank_models(two[:2]), 1)


def test_where_every_model_leaves_a_lack_of_fit_none_is_supported():
    said = sentence(rank_models([made("a", 0, misfit=True), made("b", 40, misfit=True)]), 1)
    assert said.startswith("None of the models describes the data")


def test_a_fit_without_numbers_is_last():
    first, second = rank_models([made("a", np.nan, blocks=(np.nan,) * 4), made("b", 40)])
    assert (first.model, first.weight, second.weight) == ("b", 1.0, 0.0)


@pytest.mark.parametrize(
    ("models", "said"), [("dr", "name others with --models"), ("dr,standard-linear-sold", "standard-linear-solid")]
)
def test_mistakes_are_one_clear_message(palpate, tmp_path, models, said):
    (tmp_path / "p.toml").write_text(PIPELINE.format(truth="dr", values=DAMPED, seed=1))
    done = palpate("fit", "choose", tmp_path / "p.toml", "--models", models)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_the_authors_soft_silicone_wants_memory_and_no_model_is_all_of_it(palpate, authors_log, tmp_path):
    """A real point palpation: a part that fades is supported by far, and what is left is told."""
    models = "".join(
        f'[model.{name}]\ntype = "{kind}"\nindenter = "tip"\n'
        for name, kind in (("dr", "dimensionality-reduction"), ("sls", "standard-linear-solid"))
    )
    estimator = '[estimator.fit]\ntype = "casadi-fit"\nprofile = false\n'
    (tmp_path / "p.toml").write_text(authors_log("d10mm_soft") + models + estimator)
    done = palpate("fit", "choose", "p.toml")
    assert done.returncode == 0, done.stderr
    rows = {line.split("│")[1].strip(): line.split("│") for line in done.stdout.splitlines() if line.count("│") > 6}
    assert float(rows["dr"][2]) > 20 > float(rows["sls"][2]) == 0
    assert "None of the models describes" in done.stdout
    assert 80 < float(rows["sls"][-2].split("±")[0]) < float(rows["dr"][-2].split("±")[0]) < 150
