"""Run folders that are damaged: each reader says so in words, or reads what is left; none ends in a traceback."""

import json
import random
import shutil
from collections import Counter

import pytest
from palpate import Parameter
from palpate_kit.runs.estimates_columns import columns_of

from tests.report.run_damage import damage
from tests.result_documents import result, track

READERS = (
    ("report", "run", "--out", "page.html"),
    ("report", "budget", "run"),
    ("plot", "run", "--out", "pictures", "--format", "svg"),
    ("map", "run"),
    ("map", "lumps", "run"),
    ("map", "curves", "run"),
    ("repeat", "run", "run"),
    ("repeat", "review", "run"),
    ("spectrum", "run"),
    ("fit", "indentation", "run"),
    ("control", "run", "--reference", "112.5 kPa", "--uncertainty", "1.5 kPa"),
    ("info", "run/log.mcap"),
)
SHORT = ("trajectory.press.duration=2 s",)


@pytest.fixture
def written(root, tmp_path):
    """A run folder as a run writes it, without the run."""
    folder = tmp_path / "written"
    folder.mkdir()
    effects = {"elasticity": {"sensitivity": 1.0, "contribution": 1.0, "percent": 1.0}}
    row = {"source": "radius", "std": 1e-4, "unit": "m", "effects": effects}
    document = result({name: track("note", budget=[row]) for name in ("dr/ekf", "dr/kinematic")})
    (folder / "result.json").write_text(json.dumps(document))
    (folder / "pipeline.toml").write_text((root / "pipelines" / "filters.toml").read_text())
    parameter = Parameter("elasticity", "E", "Pa", "stiffness")
    names = columns_of(dict.fromkeys(document["tracks"], (parameter,)))
    rows = [",".join([f"{i / 100}", *[f"{i + k}" for k in range(1, len(names))]]) for i in range(20)]
    (folder / "estimates.csv").write_text("\n".join([",".join(names), *rows, ""]))
    return folder


def outcome(palpate, made, folder, reader, seed):
    """What a reader says of a run that is damaged by a seed."""
    shutil.rmtree(folder / "run", ignore_errors=True)
    shutil.copytree(made, folder / "run")
    done = damage(folder / "run", random.Random(seed), "log.mcap" if reader[0] in ("info", "spectrum") else "*")
    answer = palpate(*reader)
    assert "Traceback" not in answer.stderr, f"{seed}: {done}: {' '.join(reader)}: {answer.stderr}"
    assert answer.returncode in (0, 2), f"{seed}: {done}: {' '.join(reader)}: {answer.stderr}"
    return answer.returncode


@pytest.mark.slow
@pytest.mark.parametrize(
    "reader", [("report", "budget", "run"), ("repeat", "run", "run"), ("map", "curves", "run")], ids=str
)
def test_a_sample_of_damaged_runs(palpate, written, tmp_path, reader):
    found = Counter(outcome(palpate, written, tmp_path, reader, seed) for seed in range(8))
    assert found[2]


@pytest.mark.slow
@pytest.mark.parametrize("reader", READERS, ids=lambda reader: " ".join(reader[:2]))
@pytest.mark.parametrize("example", ["filters", "sweep"])
def test_damaged_runs(palpate, runs, tmp_path, example, reader):
    made = runs(example, *(SHORT if example == "filters" else ()))
    found = Counter(outcome(palpate, made, tmp_path, reader, seed) for seed in range(21))
    assert found[2]


@pytest.mark.parametrize("key", ["source", "std", "unit", "effects"])
@pytest.mark.parametrize(
    "reader", [("report", "written", "--out", "page.html"), ("report", "budget", "written")], ids=["report", "budget"]
)
def test_a_row_of_a_budget_that_lacks_a_key_is_named(palpate, written, key, reader):
    path = written / "result.json"
    document = json.loads(path.read_text())
    name, track = next(iter(document["tracks"].items()))
    del track["budget"][0][key]
    path.write_text(json.dumps(document))
    done = palpate(*reader)
    assert done.returncode == 2
    assert f"result.json: is a damaged result of palpate: tracks.{name}.budget" in done.stderr.replace("\n", "")
    assert key in done.stderr


@pytest.mark.parametrize(
    ("table", "reader"),
    [
        ({"one-frequency": {"fading": 0.1, "looks_like": {"viscosity": {}}}}, ("report", "budget", "written")),
        ({"innovations": {"autocorrelation": ["x"], "interval": 1}}, ("plot", "written", "innovations")),
    ],
)
def test_a_table_that_no_schema_describes_is_named_where_it_is_damaged(palpate, written, table, reader):
    path = written / "result.json"
    document = json.loads(path.read_text())
    for one in document["tracks"].values():
        one["diagnoses"] = table
    path.write_text(json.dumps(document))
    done = palpate(*reader)
    assert done.returncode == 2
    assert "result.json: is a damaged result of palpate: tracks.dr/" in done.stderr


@pytest.mark.parametrize("file", ["pipeline.toml", "estimates.csv", "result.json"])
def test_bytes_that_are_no_text_are_named(palpate, written, file):
    path = written / file
    path.write_bytes(path.read_bytes().replace(b"e", b"\xff", 1))
    done = palpate("map", "written")
    assert done.returncode == 2
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("out", ["taken/pictures", "taken", "/proc/pictures"])
def test_pictures_into_a_folder_that_cannot_be_made(palpate, written, tmp_path, out):
    (tmp_path / "taken").write_text("a file")
    done = palpate("plot", "written", "estimates", "--out", out)
    assert done.returncode == 2
    assert f"{out}: cannot make the output folder: " in done.stderr
