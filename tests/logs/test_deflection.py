"""A stage beside what a beam yields by: never the position, and asked about unless the depth is there."""

import json
from itertools import pairwise

import numpy as np
import pytest
from palpate import Batch, Channel, Samples, Stream, to_si
from palpate_engine import AlignmentSettings
from palpate_engine.alignment import Ports
from palpate_engine.alignment.aligner import Aligner
from palpate_fits.file_questions import question_of_file
from palpate_logs.csv_roles import suggest_csv

STAGE, BEAM, DEPTH, FORCE = "stage (mm)", "beam deflection (mm)", "indentation (mm)", "force (N)"


def table(path, *names):
    """A press of a soft half-space by a beam of 0.4 N/mm."""
    depth = np.concatenate([np.zeros(100), np.linspace(0.0, 1.5, 300)])
    noise = np.random.default_rng(0).standard_normal((2, 400))
    force = 0.3 * (depth / 1.5) ** 1.5 + 2e-3 * noise[0]
    columns = {STAGE: depth + force / 0.4, BEAM: force / 0.4, DEPTH: depth + 1e-3 * noise[1], FORCE: force}
    rows = zip(0.01 * np.arange(400), *(columns[name] for name in names))
    path.write_text(
        ",".join(["time (s)", *names]) + "\n" + "".join(",".join(f"{x:.5f}" for x in row) + "\n" for row in rows)
    )
    return path


def test_a_stage_beside_a_deflection_is_asked_about(tmp_path):
    """The stage was taken for the tip: 25 for 60 kPa."""
    path = table(tmp_path / "beam.csv", STAGE, BEAM, FORCE)
    (blank,) = suggest_csv(path, {}).blanks
    assert blank.startswith("position-of: the force is one constant times beam deflection (mm)")
    question = question_of_file(suggest_csv(path, {}), {})
    assert (question.key, question.choices, question.needed) == ("position", ("tip", "stage"), True)
    for stated in ({"position-of": "tip"}, {"position": STAGE}):
        found = suggest_csv(path, stated)
        assert not found.blanks
        assert found.device["columns"]["position"]["column"] == STAGE
        assert "beam" not in found.alignment


def test_the_beam_of_a_stage_is_the_constant_of_force_over_deflection(tmp_path):
    found = suggest_csv(table(tmp_path / "beam.csv", STAGE, BEAM, FORCE), {"position-of": "stage"})
    assert found.device["columns"]["position"]["column"] == STAGE
    assert to_si(found.alignment["beam"], "N/m") == pytest.approx(400.0, rel=1e-3)


def test_a_depth_beside_both_is_the_position(tmp_path):
    found = suggest_csv(table(tmp_path / "depth.csv", STAGE, BEAM, DEPTH, FORCE), {})
    assert found.device["columns"]["position"]["column"] == DEPTH


def test_one_length_alone_is_the_position_however_linear(tmp_path):
    """A cylinder's force is proportional to its depth."""
    found = suggest_csv(table(tmp_path / "flat.csv", BEAM, FORCE), {})
    assert found.device["columns"]["position"]["column"] == BEAM


@pytest.mark.slow
@pytest.mark.parametrize(
    ("columns", "options"),
    [
        ((STAGE, BEAM, FORCE), ("--position-of", "stage")),
        ((STAGE, FORCE), ("--position-of", "stage", "--beam", "400 N/m")),
        ((STAGE, FORCE), ("--beam", "0.4 N/mm")),
    ],
)
def test_what_the_beam_yields_is_taken_off(palpate, tmp_path, columns, options):
    """A half-space of 55 kPa, which the stage alone takes for 15."""
    path = table(tmp_path / "beam.csv", *columns)
    told = palpate("fit", str(path), "--tip", "paraboloid 3 mm", "--json", "-o", str(tmp_path / "fit"), *options)
    (row,) = json.loads(told.stdout)["files"]
    right = 0.3 / (16 / 9 * np.sqrt(3e-3) * 1.5e-3**1.5)
    assert float(row["elasticity"]) == pytest.approx(right, rel=0.02)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--position-of", "stage"), "how stiff is the beam or spring"),
        (("--beam", "400 N/m", "--position-of", "tip"), "correct one of them"),
        (("--beam", "400 N/m +- -8 N/m"), "an uncertainty is not negative"),
    ],
)
def test_a_beam_that_is_stated_by_half_is_refused(palpate, tmp_path, options, words):
    path = table(tmp_path / "beam.csv", STAGE, FORCE)
    refused = palpate("fit", str(path), "--tip", "paraboloid 3 mm", *options)
    assert refused.returncode == 2
    assert words in refused.stderr


def test_samples_behind_a_beam_do_not_depend_on_how_blocks_are_cut():
    """The velocity needs the force at the next instant, too, which is of another stream and comes later."""
    settings = AlignmentSettings.model_validate(
        {
            "force": "a.f",
            "position": "b.z",
            "beam": "400 N/m",
            "tare": "0 N",
            "touch_force": "50 mN",
            "touch_lag": "0 s",
        }
    )
    ports = Ports.of(
        settings, {"a": (Stream("", (Channel("f", "N"),), None),), "b": (Stream("", (Channel("z", "m"),), None),)}
    )
    stamps = np.arange(200, dtype=np.int64) * 5_000_000
    random = np.random.default_rng(1)
    signals = {"a": (stamps + 1_000_000, random.normal(size=200)), "b": (stamps, 1e-3 * random.normal(size=200))}

    def samples(cuts):
        aligner, found = Aligner(settings, ports), []
        for first, last in pairwise([0, *cuts, 200]):
            for device, (time, values) in signals.items():
                part = slice(first, last)
                aligner.feed(device, Batch("", time[part], time[part], values[part, None]))
                found.append(aligner.samples())
        found.append(aligner.samples(final=True))
        return Samples.joined([block for block in found if len(block)])

    whole = samples([])
    force = np.interp(whole.stamp, signals["a"][0], signals["a"][1])
    np.testing.assert_allclose(whole.position, signals["b"][1][1 : 1 + len(whole)] + force / 400.0, rtol=1e-9)
    for cuts in ([50], [1, 2, 3, 4, 5], range(1, 200, 7)):
        part = samples(cuts)
        for name in ("stamp", "force", "position", "velocity"):
            np.testing.assert_array_equal(getattr(part, name), getattr(whole, name))


@pytest.mark.slow
def test_the_stiffness_of_the_beam_is_a_row_of_the_budget_as_large_as_by_another_fit(palpate, tmp_path):
    """Of 1 % of the stiffness; where nothing is stated of it, the values hold for it, and 5 % are the alternative."""
    path = table(tmp_path / "beam.csv", STAGE, FORCE)

    def fitted(name, beam):
        options = ("--tip", "paraboloid 3 mm", "--delay", "0 s +- 1 us", "--beam", beam)
        done = palpate("fit", str(path), *options, "-o", str(tmp_path / name))
        assert done.returncode in (0, 1), done.stderr
        pipeline = str(tmp_path / name / "pipeline.toml")
        palpate("fit", str(path), "--pipeline", pipeline, "-o", str(tmp_path / f"{name}-whole"))
        result = json.loads((tmp_path / f"{name}-whole" / "beam" / "result.json").read_text())
        return next(iter(result["tracks"].values()))

    stated, stiffer, open_ = (fitted(f"f{i}", text) for i, text in enumerate(("400 N/m +- 1 %", "404 N/m", "400 N/m")))
    name = next(iter(stated["parameters"]))
    values = [track["parameters"][name]["value"] for track in (stated, stiffer)]
    (row,) = [row for row in stated["budget"] if row["source"] == "beam"]
    assert row["std"] == pytest.approx(4.0)
    assert row["effects"][name]["contribution"] == pytest.approx(abs(values[1] - values[0]), rel=0.1)
    assert abs(values[1] / values[0] - 1) > 0.005
    assert not [row for row in open_["budget"] if row["source"].startswith("beam")]
    condition = {one["fact"]: one for one in open_["conditions"]}["beam"]
    assert condition["alternative"] == "420 N/m"
    assert condition["shifts"][name] == pytest.approx(5 * (values[1] - values[0]), rel=0.2)
    assert "beam" not in {one["fact"] for one in stated["conditions"]}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("head", "cell", "rig"),
    [
        ("beam", {"a": "400 N/m", "b": ""}, ""),
        ("beam", {"a": "", "b": "none"}, 'beam = "400 N/m"'),
        ("position_of", {"a": "stage", "b": "tip"}, 'beam = "400 N/m"'),
        ("position_of", {"a": "", "b": "tip"}, 'beam = "400 N/m"\nposition = "stage"'),
    ],
)
def test_of_a_mixed_folder_each_file_says_what_its_position_is_of(palpate, tmp_path, head, cell, rig):
    """A stage behind a beam beside a file whose position is the tip's: facts of single files are in ``curves.csv``."""
    folder = tmp_path / "mixed"
    folder.mkdir()
    table(folder / "a.csv", STAGE, FORCE)
    table(folder / "b.csv", DEPTH, FORCE)
    (folder / "curves.csv").write_text(
        f"curve,{head}\n" + "".join(f"{name}.csv,{text}\n" for name, text in cell.items())
    )
    if rig:
        (folder / "rig.toml").write_text(rig + "\n")
    told = palpate("fit", str(folder), "--tip", "paraboloid 3 mm", "--json", "-o", str(tmp_path / "fits"))
    assert told.returncode == 0, told.stderr
    right = 0.3 / (16 / 9 * np.sqrt(3e-3) * 1.5e-3**1.5)
    for row in json.loads(told.stdout)["files"]:
        assert float(row["elasticity"]) == pytest.approx(right, rel=0.03), row["curve"]


@pytest.mark.slow
def test_two_files_with_a_deflection_are_read_as_curves_csv_states(palpate, tmp_path):
    """Of one the column of the stage is corrected already."""
    folder = tmp_path / "mixed"
    folder.mkdir()
    table(folder / "a.csv", STAGE, BEAM, FORCE)
    corrected = table(folder / "b.csv", DEPTH, BEAM, FORCE)
    corrected.write_text(corrected.read_text().replace(DEPTH, STAGE))
    (folder / "curves.csv").write_text("curve,position_of\na.csv,stage\nb.csv,tip\n")
    told = palpate("fit", str(folder), "--tip", "paraboloid 3 mm", "--json", "-o", str(tmp_path / "fits"))
    right = 0.3 / (16 / 9 * np.sqrt(3e-3) * 1.5e-3**1.5)
    for row in json.loads(told.stdout)["files"]:
        assert float(row["elasticity"]) == pytest.approx(right, rel=0.05), row["curve"]
