"""``palpate fit`` and ``palpate repeat`` on the real command line."""

import json

import numpy as np
import pytest

MODELS = '''
from palpate import ContactModel, Parameter, plugin

class KelvinVoigt(ContactModel):
    """Spring and damper."""

    parameters = (
        Parameter("stiffness", "K", "N/m", "spring", role="elastic"),
        Parameter("damping", "B", "N*s/m", "damper", role="viscous"),
    )

    def force(self, depth, rate, theta, memory=()):
        return theta[0] * depth + theta[1] * rate

@plugin
def palpate_models():
    return {"my-kelvin-voigt": KelvinVoigt}
'''

PIPELINE = """
[run]
plugins = ["models.py"]
[device.log]
type = "csv-replay"
file = "v0.csv"
rate = "500 Hz"
columns = { z = { column = 0, unit = "mm" }, v = { column = 1, unit = "mm/s" }, fz = { column = 2, unit = "N" } }
[alignment]
force = { channel = "log.fz", uncertainty = "0.2 ms" }
position = "log.z"
velocity = "log.v"
tare_duration = "0.2 s"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
[model.kv]
type = "my-kelvin-voigt"
[estimator.fit]
type = "casadi-fit"
segment = "cycle"
"""

E, ETA = 112.5e3, 362.0


def write_log(path, speed, elasticity=E, seed=0, cycles=1):
    """A log of triangular presses: z [mm], v [mm/s], F [N]."""
    random = np.random.default_rng(seed)
    n = int(4e-3 / speed * 500)
    height = 1e-3 - np.concatenate([np.arange(n), np.arange(n)[::-1]]) * speed / 500
    height = np.concatenate([np.full(150, 1e-3), np.tile(height, cycles)])
    velocity = np.concatenate([np.zeros(150), np.tile(np.repeat([-speed, speed], n), cycles)])
    depth = np.maximum(-height, 0.0)
    force = 16 / 9 * elasticity * np.sqrt(5e-3) * depth**1.5 - 8 * ETA * np.sqrt(5e-3 * depth) * velocity
    force = np.maximum(force, 0) + 0.02 * random.standard_normal(len(depth))
    np.savetxt(path, np.column_stack([1e3 * height, 1e3 * velocity, force]), delimiter=",")


@pytest.fixture
def logs(tmp_path):
    (tmp_path / "models.py").write_text(MODELS)
    (tmp_path / "fit.toml").write_text(PIPELINE)
    for name, speed in (("v0", 6e-3), ("v1", 4e-3), ("v2", 8e-3)):
        write_log(tmp_path / f"{name}.csv", speed)
    return tmp_path


def budget_of(title, text):
    """The rows of a printed budget, to the combined one."""
    for line in text.partition(f"uncertainty budget of {title}")[2].splitlines():
        cells = [cell.strip() for cell in line.strip("│").split("│")]
        if len(cells) == 6:
            yield cells
        if cells[0] == "combined":
            return


@pytest.mark.slow
def test_models_and_logs_are_compared_and_evaluated_on_each_other(palpate, logs):
    asked = ["fit", "compare", "v0.csv", "v1.csv", "v2.csv", "--pipeline", "fit.toml", "--out", "out"]
    brief = palpate(*asked)
    assert brief.returncode == 0, brief.stderr
    # Commands are not broken.
    assert max(len(line) for line in brief.stdout.splitlines() if "palpate " not in line) <= 80
    assert "prefers dr/fit over kv/fit" in brief.stdout
    assert "AIC" not in brief.stdout
    done = palpate(*asked, "--details", COLUMNS="200")
    assert done.returncode == 0, done.stderr
    for words in ("residual", "BIC", "prefers dr/fit over kv/fit", "uncertainty budget of v0: dr/fit", "on v2"):
        assert words in done.stdout
    *rows, combined = budget_of("v0: dr/fit", done.stdout)
    assert {"radius (not declared)", "poisson (not declared)"} <= {row[0] for row in rows}
    for column in (3, 5):  # per cent of each parameter
        every = [float(row[column]) for row in rows if row[column] != "?"]
        assert np.hypot.reduce(every) == pytest.approx(float(combined[column]), rel=0.01)
    document = json.loads((logs / "out" / "fit.json").read_text())
    assert set(document["logs"]) == {"v0", "v1", "v2"}
    evaluation = {(r["track"], r["fitted_on"], r["on"]): r for r in document["evaluation"]}
    assert len(evaluation) == 2 * 3 * 3
    for source in ("v0", "v1", "v2"):
        for target in ("v0", "v1", "v2"):
            rss = {track: evaluation[track, source, target]["rss"] for track in ("dr/fit", "kv/fit")}
            assert rss["kv/fit"] > 2 * rss["dr/fit"]
    own, there = evaluation["dr/fit", "v0", "v0"], document["logs"]["v0"]["tracks"]["dr/fit"]["details"]
    assert own["rss"] == pytest.approx(there["rss"], rel=1e-6)
    for log in ("v0", "v1", "v2"):
        for picture in ("force.png", "residuals.png"):
            assert (logs / "out" / log / picture).stat().st_size > 10_000
        assert (logs / "out" / log / "pipeline.toml").exists()


@pytest.mark.slow
def test_no_order_of_logs_or_tracks_changes_a_result(palpate, logs):
    palpate("fit", "v0.csv", "v1.csv", "--pipeline", "fit.toml", "--out", "one", "--no-pictures")
    text = (logs / "fit.toml").read_text()
    head, tail = text.split("[model.dr]")
    dr, rest = tail.split("[model.kv]")
    kv, estimator = rest.split("[estimator.fit]")
    (logs / "turned.toml").write_text(f"{head}[model.kv]{kv}[model.dr]{dr}[estimator.fit]{estimator}")
    palpate("fit", "v1.csv", "v0.csv", "--pipeline", "turned.toml", "--out", "two", "--no-pictures")
    one, two = (json.loads((logs / name / "fit.json").read_text()) for name in ("one", "two"))
    for log in ("v0", "v1"):
        for track in ("dr/fit", "kv/fit"):
            found = [document["logs"][log]["tracks"][track] for document in (one, two)]
            for result in found:
                del result["seconds_per_sample"]
            assert found[0] == found[1]


@pytest.mark.gate
@pytest.mark.slow
def test_a_run_with_several_fits_prints_one_comparison(palpate, logs):
    done = palpate("run", "fit.toml", "--out", "out")
    assert done.returncode == 0, done.stderr
    assert "AIC" not in done.stdout
    assert "the record prefers dr/fit over kv/fit" in done.stdout
    details = json.loads((logs / "out" / "result.json").read_text())["tracks"]["dr/fit"]["details"]
    assert {"covariance", "identifiability", "aic", "bic", "rss", "unknowns"} <= set(details)


@pytest.mark.slow
def test_cycles_are_fitted_by_themselves_and_repeat_reads_them(palpate, logs):
    for name, elasticity in (("soft", E), ("hard", 1.2 * E)):
        write_log(logs / f"{name}.csv", 6e-3, elasticity, seed=3, cycles=4)
        done = palpate(
            "fit", "cycles", f"{name}.csv", "--pipeline", "fit.toml", "--out", name, "--no-pictures",
            "--set", "run.tracks=['dr/*']",
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert "every cycle by itself" in done.stdout
    done = palpate("repeat", "--group", "hard=har?", "--group", "soft=sof?", "--json", "--picture", "repeat.png")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["groups"]["soft"]["count"] == document["groups"]["hard"]["count"] == 4
    assert document["groups"]["soft"]["mean"] == pytest.approx(E, rel=0.02)
    (test,) = document["tests"]
    assert test["p"] < 1e-3
    assert test["difference"] == pytest.approx(-0.2 * E, rel=0.1)
    assert (logs / "repeat.png").stat().st_size > 10_000
    shown = palpate("repeat", "--group", "hard=hard", "--group", "soft=soft")
    assert "Welch's t-test" in shown.stdout
    assert "baseline sites" in " ".join(shown.stdout.split())
    assert "###" not in shown.stdout
    assert "###" in palpate("repeat", "--group", "hard=hard", "--details").stdout


@pytest.mark.slow
def test_repeat_over_run_folders(palpate, logs):
    for k in range(3):
        write_log(logs / "v0.csv", 6e-3, seed=k)
        palpate("run", "fit.toml", "--out", f"run{k}", "--set", "run.tracks=['dr/*']")
    runs = [json.loads((logs / f"run{k}" / "result.json").read_text()) for k in range(3)]
    values = [run["tracks"]["dr/fit"]["parameters"]["elasticity"]["value"] for run in runs]
    for order in (("run0", "run1", "run2"), ("run2", "run0", "run1")):
        document = json.loads(palpate("repeat", *order, "--json").stdout)
        found = document["groups"]["runs"]
        assert found["values"] == values
        assert found["std"] == pytest.approx(np.std(values, ddof=1))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fit", "nothing.csv"], "no such file"),
        (["fit", "v0.csv"], "say with --pipeline"),
        (["fit", "compare", "v0.csv", "--pipeline", "fit.toml"], "give two logs or more; palpate fit is for one"),
        (["fit", "fit.toml", "--set", "estimator.fit.type=ekf"], "unknown key 'segment'"),
        (["fit", "fit.toml", "--set", "estimator.fit.segment=press"], "'press' is not one of"),
        (["fit", "fit.toml", "--set", "estimator.fit={type='ekf'}"], "no offline estimator"),
        (["repeat"], "name at least one run folder"),
        (["repeat", "fit.toml"], "has no table [repeat]"),
        (["repeat", "--group", "soft"], "write NAME=PATTERN"),
        (["repeat", "--group", "soft=nothing*"], "nothing matches"),
    ],
)
def test_mistakes_are_told_in_a_sentence(palpate, logs, arguments, words):
    done = palpate(*arguments)
    assert done.returncode == 2, done.stdout + done.stderr
    assert words in done.stderr
    assert "Traceback" not in done.stderr


def test_a_log_without_contact_is_flagged_and_not_drawn(palpate, logs):
    write_log(logs / "air.csv", 6e-3, elasticity=0.0)
    done = palpate("fit", "air.csv", "--pipeline", "fit.toml", "--out", "out", "--set", "run.tracks=['dr/*']")
    assert done.returncode == 0, done.stderr
    assert "invalid[no-contact]" in done.stdout
    assert "help: " in done.stdout
    assert not (logs / "out" / "air" / "force.png").exists()
