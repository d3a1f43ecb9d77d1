"""``palpate bench``: records of scenes and logs through all tracks, one table; failures are rows."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from palpate_engine import load_pipeline
from palpate_kit.comparison.record_rows import record_rows
from palpate_kit.comparison.standard_set import SCENES, SLOW_SCENES, scene_files
from palpate_kit.terminal.table import console
from palpate_studies.bench.bench_table import lines_below, scene_matrix, scene_table, summaries

OWN = '''
import numpy as np
from palpate import Belief, Estimator, plugin, track_by_step


class Stuck(Estimator):
    """Says 90 kPa, whatever it sees."""

    def start(self, problem):
        theta = np.array([9e4, 300.0])
        return track_by_step(2, lambda moment: Belief(theta, 0.01 * theta, 4e-3, 1e-4, 1.0))


class Broken(Stuck):
    """Raises where it starts."""

    def start(self, problem):
        raise ValueError("no such start")


class Nan(Stuck):
    """Has no number."""

    def start(self, problem):
        theta = np.full(2, np.nan)
        return track_by_step(2, lambda moment: Belief(theta, theta, 4e-3, 1e-4, 1.0))


@plugin
def palpate_estimators():
    return {"stuck": Stuck, "broken": Broken, "nan": Nan}
'''


def row(scene, track, number, error=0.01, off=0.5, **more):
    measured = {"prediction": 0.02, "nis": 1.0, "settled": 0.5, "seconds_per_sample": 1e-6, "samples": 100}
    values = {"elasticity_error": error, "elasticity_off": off} if error is not None else {}
    return {"scene": scene, "track": track, "record": number, **measured, "reason": "", **values, **more}


def test_errors_are_summed_up_over_records_and_failures_are_counted():
    rows = [row("sine", "dr/a", n, error=error, off=off) for n, (error, off) in enumerate([(0.03, 1.0), (0.04, 3.0)])]
    rows.append({"scene": "sine", "track": "dr/a", "record": 3, "reason": "failed: ValueError"})
    (found,) = summaries(rows)
    assert found["elasticity_error"] == pytest.approx(math.sqrt((0.03**2 + 0.04**2) / 2))
    assert found["elasticity_within_2u"] == 0.5
    assert (found["records"], found["failed"], found["reason"]) == (3, 1, "failed: ValueError")


def test_the_screen_has_a_row_for_each_track_and_a_column_for_each_scene(capsys):
    rows = [row("sine", "dr/a", 1), row("sine", "dr/b", 1, error=0.5, off=9.0), row("memory", "dr/a", 1, error=None)]
    rows.append({"scene": "memory", "track": "dr/b", "record": 1, "reason": "diverged"})
    console(80).print(scene_matrix(summaries(rows)).view())
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert lines[0][:3] == ["dr/", "sine", "memory"]
    assert lines[1][:3] == ["a", "1", "(2)"]
    assert lines[2][:3] == ["b", "50!", "failed"]
    assert any("memory dr/b: diverged" in line for line in lines_below(summaries(rows)))


def test_a_coverage_is_shown_with_its_interval_from_a_hundred_records_on():
    few, many = ([row("sine", "dr/a", n, off=0.5 if n % 20 else 3.0) for n in range(count)] for count in (20, 100))
    assert not any("in 2 u" in head for head in scene_table(summaries(few)).headings)
    table = scene_table(summaries(many))
    cell = dict(zip(table.headings, table.rows[0], strict=True))["E\n% in 2 u"]
    assert cell == "95 (89 to 98)"  # by Wilson


def test_all_scenes_have_the_same_tracks_and_are_read():
    pipelines = [load_pipeline(file) for file in scene_files()]
    names = [sorted(str(track.name) for track in pipeline.tracks) for pipeline in pipelines]
    assert all(one == names[0] for one in names)
    assert [pipeline.run.name for pipeline in pipelines] == list(SCENES)
    assert len(names[0]) == 8
    (slow,) = scene_files(SLOW_SCENES)
    assert load_pipeline(slow).run.name == "sine"


@pytest.mark.slow
def test_a_sweep_is_compared_with_the_truth_at_each_place():
    """A constant 112.5 kPa is wrong over the stiff half, by half of it."""
    file = next(file for file in scene_files() if file.stem == "step")
    pipeline = load_pipeline(file, ('run.tracks=["dr/kinematic", "dr/ekf"]',))
    rig = pipeline.devices["rig"]
    soft, stiff = rig.truth_at(np.array([[0.0, -0.016], [0.0, 0.016]]))["elasticity"]
    assert (soft, stiff) == pytest.approx((112.5e3, 1.5 * 112.5e3), rel=0.02)
    rows = {one["track"]: one for one in record_rows(pipeline, 1)}
    assert rows["dr/kinematic"]["elasticity_error"] < 0.02 < 0.1 < rows["dr/ekf"]["elasticity_error"]


def one_scene(tmp_path, name="sine"):
    text = next(file for file in scene_files() if file.stem == name).read_text()
    (tmp_path / "rig.toml").write_text((scene_files()[0].parent / "rig.toml").read_text())
    kept = text.replace('name = "sine"', 'name = "sine"\ntracks = ["dr/kinematic", "*/stuck", "*/broken", "*/nan"]')
    file = tmp_path / "sine.toml"
    file.write_text(kept.replace('duration = "6 s"', 'duration = "2 s"'))
    return file


def rows_of(folder):
    with (folder / "records.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_own_filters_take_part_and_one_that_fails_is_a_row_with_its_reason(palpate, tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    file, out = one_scene(tmp_path), tmp_path / "out"
    command = ("bench", file, "--plugin", tmp_path / "own.py", "--records", "2", "--jobs", "1", "--out", out)
    done = palpate(*command)
    assert done.returncode == 0, done.stderr
    assert "2 records, 4 estimates failed" in done.stdout
    text = " ".join(done.stdout.split())
    assert "no such start" in text
    assert "stopped being finite" in text
    found = {(one["track"], one["record"]): one for one in rows_of(out)}
    assert float(found["dr/stuck", "1"]["elasticity_error"]) == pytest.approx(0.2)
    assert float(found["dr/stuck", "1"]["elasticity_off"]) > 2
    assert float(found["dr/kinematic", "1"]["elasticity_error"]) < 0.02

    # A bench that was stopped goes on with what is missing, to the same bits.
    lines = (out / "rows.jsonl").read_text().splitlines()
    (out / "rows.jsonl").write_text("\n".join(line for line in lines if '"record": 1' in line) + '\n{"cut')
    done = palpate(*command)
    assert "1 found in the folder" in done.stdout
    again = {(one["track"], one["record"]): one for one in rows_of(out)}
    for key, one in found.items():
        assert {k: v for k, v in one.items() if k != "seconds_per_sample"} == {
            k: v for k, v in again[key].items() if k != "seconds_per_sample"
        }
    refused = palpate("bench", file, "--out", out, "--records", "1")
    assert refused.returncode == 2
    assert "other records or settings" in refused.stderr


@pytest.mark.slow
def test_a_study_of_a_folder_of_logs_has_the_facts_of_each(palpate, tmp_path):
    palpate("init", "log", "--out", tmp_path / "log.toml")
    (tmp_path / "logs").mkdir()
    for name in ("a.csv", "b.csv"):
        (tmp_path / "logs" / name).write_bytes((tmp_path / "log.csv").read_bytes())
    (tmp_path / "logs" / "curves.csv").write_text("curve,truth\nb.csv,elasticity 100 kPa\n")
    text = (
        (tmp_path / "log.toml")
        .read_text()
        .replace("[estimator.fit]", '[estimator.ekf]\ntype = "ekf"\n\n[estimator.fit]')
    )
    file = tmp_path / "study.toml"
    file.write_text(text + '\n[sweep]\n"device.log.file" = ["logs"]\n')
    done = palpate("bench", file, "--json", "--jobs", "1", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["records"] == 2
    found = {(one["track"], one["record"]): one for one in rows_of(tmp_path / "out")}
    assert found["dr/kinematic", "1"]["elasticity_error"] == ""
    assert float(found["dr/kinematic", "2"]["elasticity_error"]) > 0.05

    file.write_text(file.read_text().replace('tip_mass = "140 g" ', "#"))
    palpate("bench", file, "--jobs", "1", "--out", tmp_path / "massless")
    reasons = {one["track"]: one["reason"] for one in rows_of(tmp_path / "massless")}
    assert "mass is not declared" in reasons["dr/ekf"]
    assert "dr/fit" in reasons


@pytest.mark.slow
def test_the_public_logs_are_compared(palpate, shared, tmp_path, authors_log):
    """Prediction, NIS and cost of a log without a truth."""
    log = shared / "ur3e-bota-2024" / "d5mm_soft.csv.gz"
    tables = authors_log("d5mm_soft")
    file = tmp_path / "study.toml"
    own = """
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
[estimator.ekf]
type = "ekf"
[estimator.kinematic]
type = "kinematic-ekf"
"""
    swept = f'[sweep]\n"device.log.file" = ["{log}"]\n'
    file.write_text(f'[run]\nname = "authors"\n{tables}{own}{swept}')
    done = palpate("bench", file, "--jobs", "1", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    rows = rows_of(tmp_path / "out")
    assert {Path(one["track"]).name for one in rows} == {"ekf", "kinematic"}
    assert all(0 < float(one["prediction"]) < 0.5 for one in rows)


@pytest.mark.slow
def test_pictures_are_drawn_for_a_column_and_a_page(palpate, tmp_path):
    """The pictures of a step have the truth of each place, and the same bench is the same picture."""
    file = next(file for file in scene_files() if file.stem == "step")
    tracks = ("--set", 'run.tracks=["dr/kinematic", "dr/ekf"]')
    for name in ("a", "b"):
        done = palpate("bench", file, *tracks, "--records", "1", "--jobs", "1", "--picture", "--out", tmp_path / name)
        assert done.returncode == 0, done.stderr
        assert "collapsed" not in done.stderr
    names = sorted(path.name for path in (tmp_path / "a").glob("*mm.*"))
    assert names == sorted(
        f"{what}-{width}mm.{ending}"
        for what in ("errors", "estimates-step")
        for width in (85, 170)
        for ending in ("pdf", "svg")
    )
    for name in names:
        if name.startswith("estimates"):  # a cost is another one each time
            assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert 'width="481' in (tmp_path / "a" / "estimates-step-170mm.svg").read_text()  # pt


MODEL = '''
from typing import ClassVar

from palpate import ContactModel, MaterialValue, Parameter, plugin


class Ball(ContactModel):
    """A ball of 5 mm, which is part of the law."""

    parameters: ClassVar = (
        Parameter("elasticity", "E", "Pa", "stiffness", role="elastic"),
        Parameter("viscosity", "eta", "Pa*s", "damping", role="viscous"),
    )

    def force(self, depth, rate, theta, memory=()):
        return (16 / 9 * theta[0] * depth + 4 * theta[1] * rate) * (5e-3 * depth) ** 0.5

    def material(self, theta):
        return MaterialValue("elasticity", theta[0], (1.0, 0.0)), MaterialValue("viscosity", theta[1], (0.0, 1.0))


@plugin
def palpate_models():
    return {"ball": Ball}
'''


@pytest.mark.slow
def test_an_own_model_that_has_its_tip_takes_part(palpate, tmp_path):
    (tmp_path / "ball.py").write_text(MODEL)
    out = tmp_path / "out"
    command = ("bench", one_scene(tmp_path), "--plugin", tmp_path / "ball.py", "--records", "1", "--jobs", "1")
    done = palpate(*command, "--set", 'run.tracks=["*/kinematic"]', "--out", out)
    assert done.returncode == 0, done.stderr
    error = {one["track"]: float(one["elasticity_error"]) for one in rows_of(out)}
    assert error["ball/kinematic"] == pytest.approx(error["dr/kinematic"], rel=1e-6)
