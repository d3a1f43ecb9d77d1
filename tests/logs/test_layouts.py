"""Layouts of tables that people have: a small file of each in `layouts`, its right answer in a line of `layouts.csv`.

The press is that of a paraboloid of 3 mm on 50 kPa: air, a ramp and a hold. To add a layout, add a file and a line:
what is right (`value`, `asks`, `refuses`), how far force [N], position [mm] and time [s] go, the sign with which the
position counts upwards, and words of the note, the question or the refusal. All numbers are own ones.
"""

import csv
from pathlib import Path

import numpy as np
import pytest
from palpate import LogError
from palpate_kit.logs.draft_pipeline import recording_of

FOLDER = Path(__file__).parent / "layouts"
with FOLDER.with_suffix(".csv").open(newline="", encoding="utf-8") as file:
    LAYOUTS = list(csv.DictReader(file))
LIBRARIES = {".h5": "h5py", ".parquet": "pyarrow", ".feather": "pyarrow"}
TOLERANCE = {"force_N": 0.03, "travel_mm": 0.01, "seconds": 0.01}  # relative; the noise is 1 % of the force


def suggestion_of(path):
    if path.suffix in LIBRARIES:
        pytest.importorskip(LIBRARIES[path.suffix])
    reader = recording_of(path)
    return reader, reader.suggest(path, {"tip": "paraboloid 3 mm"})


def spans(reader, device):
    """How far force [N], position [mm] and time [s] of a file go."""
    log = reader.model_validate({key: value for key, value in device.items() if key != "type"})
    with log.connect(0) as link:
        batches = list(link.batches())
    time, values = np.concatenate([b.time for b in batches]), np.concatenate([b.values for b in batches])
    columns = dict(zip(device["columns"], values.T, strict=True))
    position = 1e3 * np.ptp(columns["position"])
    return {"force_N": np.ptp(columns["force"]), "travel_mm": position, "seconds": np.ptp(time) / 1e9}


def test_every_file_has_a_line():
    assert sorted(row["file"] for row in LAYOUTS) == sorted(path.name for path in FOLDER.iterdir())
    assert {row["answer"] for row in LAYOUTS} == {"value", "asks", "refuses"}


@pytest.mark.parametrize("row", [row for row in LAYOUTS if row["answer"] != "refuses"], ids=lambda row: row["file"])
def test_a_layout_is_read_or_asks_for_what_it_does_not_state(row):
    reader, suggestion = suggestion_of(FOLDER / row["file"])
    assert bool(suggestion.blanks) == (row["answer"] == "asks")
    assert row["words"] in " ".join((*suggestion.blanks, *suggestion.doubts))
    assert suggestion.alignment["position"]["sign"] == int(row["sign"])
    expected = {key: float(row[key]) for key in TOLERANCE if row[key]}
    device = {**suggestion.device} | ({"rate": "100 Hz"} if suggestion.device.get("rate") == "? Hz" else {})
    found = spans(reader, device) if expected else {}
    for key, value in expected.items():
        assert found[key] == pytest.approx(value, rel=TOLERANCE[key]), key


@pytest.mark.parametrize("row", [row for row in LAYOUTS if row["answer"] == "refuses"], ids=lambda row: row["file"])
def test_a_file_that_cannot_be_read_says_so_in_a_sentence(row):
    def read():
        reader, suggestion = suggestion_of(FOLDER / row["file"])
        spans(reader, suggestion.device)

    with pytest.raises(LogError) as refusal:
        read()
    assert row["words"] in str(refusal.value)
    assert len(str(refusal.value).splitlines()) == 1
