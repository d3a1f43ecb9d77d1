"""A result of an older palpate is read as one of today; one of a newer is refused by name."""

import json

import pytest
from palpate.errors import LogError
from palpate.host import SCHEMA, read_result
from palpate_maps.analysis import tracks_of


def _track(*flags, value=1e5, **more):
    found = {"value": value, "std": 1.0, "unit": "Pa"}
    return {"parameters": {"elasticity": found}, "surface": found, "flags": list(flags), **more}


@pytest.fixture
def written(tmp_path):
    def write(document, name="run"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "result.json").write_text(json.dumps(document))
        return tmp_path / name / "result.json"

    return write


OLD = {"palpate": "0.1.0", "tracks": {"dr/ekf": _track("not-identifiable: by 0.1 N", "gaps: log has 1 x gaps")}}


def test_flags_of_an_old_result_become_objects(written):
    track = read_result(written(OLD))["tracks"]["dr/ekf"]
    assert track["flags"] == [
        {"code": "not-identifiable", "message": "by 0.1 N", "severity": "invalid"},
        {"code": "gaps", "message": "log has 1 x gaps", "severity": "note"},
    ]
    assert track["verdict"] == "invalid"


@pytest.mark.parametrize(
    ("document", "problem"),
    [
        (
            {**OLD, "schema": SCHEMA + 1, "palpate": "9.0"},
            rf"result\.json: has schema {SCHEMA + 1} \(of palpate 9\.0\).*update",
        ),
        ({**OLD, "schema": str(SCHEMA)}, f"has schema {SCHEMA}"),
        ([], "no tracks"),
    ],
)
def test_what_cannot_be_read_is_refused_by_name(written, document, problem):
    with pytest.raises(LogError, match=problem):
        read_result(written(document))


def test_statistics_leave_out_what_is_invalid(palpate, written):
    """Of an old and of a new result alike."""
    invalid = {"schema": SCHEMA, "tracks": {"dr/ekf": _track(value=9e9, verdict="invalid")}}
    for name, document in {"old": OLD, "new": invalid}.items():
        written(document, name)
    for name in ("one", "two", "three"):
        written({"schema": SCHEMA, "tracks": {"dr/ekf": _track(verdict="doubtful")}}, name)
    found = json.loads(palpate("repeat", "old", "new", "one", "two", "three", "--json").stdout)
    assert found["skipped"] == 2
    assert found["groups"]["runs"]["count"] == 3
    assert found["groups"]["runs"]["mean"] == 1e5


def test_an_invalid_track_is_the_last_that_a_map_takes(written):
    folder = written(
        {"schema": SCHEMA, "tracks": {"a/x": _track(verdict="invalid"), "b/x": _track(verdict="note")}}
    ).parent
    (folder / "estimates.csv").write_text("time_s,a/x:status,b/x:status\n")
    assert tracks_of(folder) == ["b/x", "a/x"]
    (folder / "result.json").unlink()
    assert tracks_of(folder) == ["a/x", "b/x"]
