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
    told = palpate("fit", str(path), "--tip", "sphere 3 mm", "--json", "-o", str(tmp_path / "fit"), *options)
    (row,) = json.loads(told.stdout)["files"]
    right = 0.3 / (16 / 9 * np.sqrt(3e-3) * 1.5e-3**1.5)
    assert float(row["elasticity"]) == pytest.approx(right, rel=0.02)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--position-of", "stage"), "how stiff is the beam or spring"),
        (("--beam", "400 N/m", "--position-of", "tip"), "correct one of them"),
        (("--beam", "400 N/m +- 8 N/m"), "without its uncertainty"),
    ],
)
def test_a_beam_that_is_stated_by_half_is_refused(palpate, tmp_path, options, words):
    path = table(tmp_path / "beam.csv", STAGE, FORCE)
    refused = palpate("fit", str(path), "--tip", "sphere 3 mm", *options)
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
