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

RESULT, PIPELINE, TABLES, LOG = ("result.json",), ("pipeline.toml",), ("estimates*.csv",), ("log.mcap",)
# What each command reads of a run folder, as a trace of its files shows: damage to others would ask nothing.
READERS = (
    (("report", "run", "--out", "page.html"), (*RESULT, *PIPELINE, *TABLES, "given.toml")),
    (("report", "budget", "run"), RESULT),
    (("plot", "run", "--out", "pictures", "--format", "svg"), (*RESULT, *PIPELINE, *TABLES)),
    (("repeat", "run", "run", "--track", "dr/kinematic"), RESULT),
    (("repeat", "review", "run"), RESULT),
    (
        (
            "calibrate",
            "control",
            "run",
            "--reference",
            "112.5 kPa",
            "--uncertainty",
            "1.5 kPa",
            "--track",
            "dr/kinematic",
        ),
        RESULT,
    ),
)
OF_A_LOG = (
    (("fit", "spectrum", "run"), (*LOG, *TABLES)),
    (("fit", "indentation", "run"), (*RESULT, *LOG)),
    (("info", "run/log.mcap"), LOG),
)
OF_A_SWEEP = tuple((("map", *words, "run"), (*RESULT, *PIPELINE, *TABLES)) for words in ((), ("lumps",), ("curves",)))
EXAMPLES = {
    "filters": ("trajectory.press.duration=2 s",),
    "sweep": (
        'trajectory.sweep.start=["0 mm", "-20 mm"]',
        'trajectory.sweep.end=["0 mm", "0 mm"]',
        "trajectory.sweep.settle=2 s",
    ),
}
CASES = [("filters", *case) for case in (*READERS, *OF_A_LOG)] + [("sweep", *case) for case in (*READERS, *OF_A_SWEEP)]


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


def outcome(palpate, made, folder, reader, files, seed):
    """What a reader says of a run, one of whose files is damaged by a seed."""
    shutil.rmtree(folder / "run", ignore_errors=True)
    shutil.copytree(made, folder / "run")
    done = damage(folder / "run", random.Random(seed), files)
    answer = palpate(*reader)
    assert "Traceback" not in answer.stderr, f"{seed}: {done}: {' '.join(reader)}: {answer.stderr}"
    assert answer.returncode in (0, 2), f"{seed}: {done}: {' '.join(reader)}: {answer.stderr}"
    return answer.returncode


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize("reader", [("report", "budget", "run"), ("repeat", "review", "run")], ids=" ".join)
def test_a_sample_of_damaged_runs(palpate, written, tmp_path, reader):
    found = Counter(outcome(palpate, written, tmp_path, reader, RESULT, seed) for seed in range(8))
    assert found[2]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("example", "reader", "files"), CASES, ids=[f"{name}-{' '.join(w[:2])}" for name, w, _ in CASES]
)
def test_damaged_runs(palpate, runs, tmp_path, example, reader, files):
    """Some are refused, and the run as it was made is not."""
    made = runs(example, *EXAMPLES[example])
    shutil.copytree(made, tmp_path / "run")
    sound = palpate(*reader)
    assert sound.returncode == 0, sound.stderr
    found = Counter(outcome(palpate, made, tmp_path, reader, files, seed) for seed in range(8))
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
