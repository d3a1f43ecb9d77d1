"""A result of an older palpate is read as one of today; one of a newer is refused by name."""

import json

import pytest
from palpate.errors import LogError
from palpate_engine import SCHEMA
from palpate_kit.runs.estimates_columns import columns_of
from palpate_kit.runs.result_file import read_result
from palpate_maps.map_analysis import tracks_of

from tests.result_documents import result, track, value


@pytest.fixture
def written(tmp_path):
    def write(document, name="run"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "result.json").write_text(json.dumps(document))
        return tmp_path / name / "result.json"

    return write


def of_version_0_1():
    """Flags are texts; there is neither schema nor verdict, budget nor where the tare ends."""
    old = track(flags=["not-identifiable: by 0.1 N", "gaps: log has 1 gap"])
    del old["verdict"], old["budget"]
    document = result({"dr/ekf": old}, palpate="0.1.0")
    document["run"] |= {"tare": {"offset": 1.0, "std": 0.1, "noise": 0.2}, "live": {"rest": {"force": 1.0}}}
    document["run"]["first_touch"] = {"time": 1.0, "position": 0.0}
    del document["schema"]
    return document


OLD = of_version_0_1()


def test_flags_of_an_old_result_become_objects(written):
    track = read_result(written(OLD))["tracks"]["dr/ekf"]
    assert track["budget"] == []
    assert [(flag["code"], flag["message"], flag["severity"]) for flag in track["flags"]] == [
        ("not-identifiable", "by 0.1 N", "invalid"),
        ("gaps", "log has 1 gap", "note"),
    ]
    assert track["verdict"] == "invalid"


def test_what_an_old_result_did_not_say_yet_is_added(written):
    run = read_result(written(OLD))["run"]
    assert run["tare"]["until"] is None
    assert run["first_touch"]["by"] == "threshold"
    assert run["live"] == {"standstill": {"force": 1.0}}


@pytest.mark.parametrize(
    ("document", "problem"),
    [
        (
            {**OLD, "schema": SCHEMA + 1, "palpate": "9.0"},
            rf"result\.json: schema is {SCHEMA + 1} \(of palpate 9\.0\).*update",
        ),
        ({**OLD, "schema": str(SCHEMA)}, f"schema is {SCHEMA}"),
        ([], "no tracks"),
    ],
)
def test_what_cannot_be_read_is_refused_by_name(written, document, problem):
    with pytest.raises(LogError, match=problem):
        read_result(written(document))


def test_statistics_leave_out_what_is_invalid(palpate, written):
    """Of an old and of a new result alike."""
    invalid = result({"dr/ekf": track("invalid", parameters={"elasticity": value(9e9)})})
    for name, document in {"old": OLD, "new": invalid}.items():
        written(document, name)
    for name in ("one", "two", "three"):
        written(result({"dr/ekf": track("doubtful")}), name)
    found = json.loads(palpate("repeat", "old", "new", "one", "two", "three", "--json").stdout)
    assert found["skipped"] == 2
    assert found["groups"]["runs"]["count"] == 3
    assert found["groups"]["runs"]["mean"] == 1e5


def test_an_invalid_track_is_the_last_that_a_map_takes(written):
    folder = written(result({"a/x": track("invalid"), "b/x": track("note")})).parent
    (folder / "estimates.csv").write_text(",".join(columns_of({"a/x": (), "b/x": ()})) + "\n")
    assert tracks_of(folder) == ["b/x", "a/x"]
    (folder / "result.json").unlink()
    assert tracks_of(folder) == ["a/x", "b/x"]
