"""Several records in one table: side by side, slots, and a column that names them; each is a row."""

import csv
import json

import numpy as np
import palpate
import pytest
from palpate import ConfigurationError, LogError
from palpate_logs.csv_replay import CsvReplay
from palpate_logs.csv_roles import suggest_csv
from palpate_records.tables.table_records import records_in

TIME = np.arange(300) / 100.0
HEIGHT = 1.0 - 1.5 * np.clip(TIME - 0.7, 0.0, 1.6)  # [mm]
MODULI = (30.0, 60.0, 90.0)  # [kPa]
COLUMNS = ("time (s)", "height (mm)", "force (N)")


def presses():
    """Rows of time [s], height [mm] and force [N] of presses of a sphere of 3 mm on half-spaces."""
    for modulus in MODULI:
        force = 16 / 9 * 1e3 * modulus * np.sqrt(3e-3) * np.maximum(-1e-3 * HEIGHT, 0.0) ** 1.5
        force += 2e-3 * np.random.default_rng(0).standard_normal(len(TIME))
        yield np.column_stack([TIME, HEIGHT, force]).tolist()


def beside(head):
    """Tables side by side, the second with fewer rows."""
    tables = list(presses())
    tables[1] = tables[1][:290] + [["", "", ""]] * 10
    return [*head, *([cell for row in rows for cell in row] for rows in zip(*tables, strict=True))]


def below(name, labels, whole=True):
    """Records under each other, with a column that names them in every row, or in the first of each."""
    rows = [[name, *COLUMNS]]
    for label, table in zip(labels, presses(), strict=True):
        rows += [[label if whole or not k else "", *row] for k, row in enumerate(table)]
    return rows


def shared_time():
    """One time for all, and every other column with a number."""
    names = [f"{name} {k} ({unit})" for k in (1, 2, 3) for name, unit in (("height", "mm"), ("force", "N"))]
    joined = zip(*presses(), strict=True)
    return [["time (s)", *names], *([rows[0][0], *(cell for row in rows for cell in row[1:])] for rows in joined)]


def in_turn():
    """Slots whose readings come in turn."""
    rows = [[*COLUMNS, "slot"]]
    for readings in zip(*presses(), strict=True):
        rows += [[*row, k] for k, row in enumerate(readings, 1)]
    return rows


TITLES = ["gel A", "", "", "gel B", "", "", "C", "", ""]
LETTERS = ["gel x", "", "", "gel y", "", "", "gel z", "", ""]
SLOTS = [f"Slot {k} {name}" for k in (1, 2, 3) for name in ("Time (s)", "Height (mm)", "Force (N)")]
KINDS = {
    "the same names again": (beside([[*COLUMNS] * 3]), ["1", "2", "3"]),
    "titles above the names": (beside([TITLES, [*COLUMNS] * 3]), ["gel A", "gel B", "C"]),
    "titles that end in a letter": (beside([LETTERS, [*COLUMNS] * 3]), ["gel x", "gel y", "gel z"]),
    "slots": (beside([SLOTS]), ["Slot 1", "Slot 2", "Slot 3"]),
    "one time for all": (shared_time(), ["1", "2", "3"]),
    "a column of names": (below("specimen", ("gel A", "gel B", "C")), ["gel A", "gel B", "C"]),
    "a column with gaps": (below("Sample", ("gel A", "gel B", "C"), whole=False), ["gel A", "gel B", "C"]),
    "a column of numbers": (below("point", (1, 2, 3)), ["1", "2", "3"]),
    "in turn": (in_turn(), ["1", "2", "3"]),
}  # fmt: skip


def written(path, rows):
    """The file of some rows."""
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_every_record_is_read_alone(tmp_path, kind):
    """All of them were read as one, or the first alone, or asked for a column."""
    rows, names = KINDS[kind]
    path = written(tmp_path / "gels.csv", rows)
    assert [record.name for record in records_in(path)] == names == list(CsvReplay.records(path, {}))
    for name, table in zip(names, presses(), strict=True):
        suggestion = suggest_csv(path, {"record": name})
        assert not suggestion.rivals
        assert not any("records" in text for text in suggestion.doubts)
        device = CsvReplay.model_validate({k: v for k, v in suggestion.device.items() if k != "type"})
        with device.connect(0) as link:
            found = next(iter(link.batches()))
        count = 290 if kind in list(KINDS)[:4] and name == names[1] else 300
        assert device.warnings == ()
        force = found.values[:, list(device.columns).index("force")]
        np.testing.assert_array_equal(force, [row[2] for row in table[:count]])
        np.testing.assert_array_equal(found.time, np.rint(1e9 * TIME[:count]))


@pytest.mark.parametrize(
    "names",
    [
        ("time (s)", "force_x (N)", "force_z (N)", "pos_x (mm)", "pos_z (mm)"),
        ("time (s)", "raw force (N)", "raw height (mm)", "filtered force (N)", "filtered height (mm)"),
        ("time (s)", "height (mm)", "height 2 (mm)", "force 1 (N)", "force 2 (N)"),
        ("timestamp", "actual_TCP_pose_0", "actual_TCP_pose_1", "actual_TCP_force_0", "actual_TCP_force_1"),
        ("time (s)", "height (mm)", "force (N)", "sample", "state"),
    ],
)
def test_what_is_one_record_stays_one(tmp_path, names):
    """Components of a vector, a quantity and what was made of it, two load cells, a count of the rows."""
    table = np.array(next(presses()))
    columns = [table[:, [0, 2, 1, 2, 1][k]] for k in range(5)]
    if "sample" in names:
        columns[3] = np.arange(300.0)
    assert records_in(written(tmp_path / "one.csv", [names, *np.column_stack(columns).tolist()])) == ()


def test_a_file_of_several_says_so(palpate, tmp_path):
    """Whoever looks at it or takes it as a whole."""
    path = written(tmp_path / "gels.csv", KINDS["a column of names"][0])
    words = "the file holds 3 records (gel A, gel B, C): record = NAME reads one of them"
    assert words in suggest_csv(path, {}).doubts
    assert words in " ".join(palpate("info", "gels.csv").stdout.split())


def test_a_record_that_is_not_there_is_named(tmp_path):
    path = written(tmp_path / "gels.csv", KINDS["a column of names"][0])
    with pytest.raises(LogError, match=r"no record 'gel B2'; did you mean 'gel B'\?"):
        suggest_csv(path, {"record": "gel B2"})


def test_python_reads_the_same_records(tmp_path):
    """The first of 27 sheets was read, and nothing said of the others."""
    path = written(tmp_path / "gels.csv", KINDS["slots"][0])
    with pytest.raises(ConfigurationError, match=r'holds 3 records \(Slot 1, Slot 2, Slot 3\).*"record": "Slot 1"'):
        palpate.read(path)
    one = palpate.read(path, {"record": "Slot 3"})
    assert one.name == "gels.csv:Slot 3"
    (batch,) = one.readings.values()
    assert len(batch.time) == 300


@pytest.mark.slow
def test_each_record_is_a_row_and_a_place_on_the_map(palpate, tmp_path, monkeypatch):
    """Presses of a grid were fitted as one, with a hint at a pipeline to write; now they go to the map at once."""
    monkeypatch.chdir(tmp_path)
    rows = [
        [*row, 5 * (k % 2), 5 * (k // 2), k] for k, table in enumerate([*presses(), *presses()][:4]) for row in table
    ]
    written(tmp_path / "grid.csv", [[*COLUMNS, "x_mm", "y_mm", "point"], *rows])
    told = palpate("fit", "grid.csv", "--tip", "paraboloid 3 mm", "--json", "-o", "fits")
    found = json.loads(told.stdout)["files"]
    assert [row["curve"] for row in found] == [f"grid.csv:{k}" for k in range(4)]
    np.testing.assert_allclose([float(row["elasticity"]) for row in found], [30e3, 60e3, 90e3, 30e3], rtol=0.02)
    np.testing.assert_allclose([[float(row["x"]), float(row["y"])] for row in found][1:3], [[5e-3, 0], [0, 5e-3]])
    assert palpate("map", "fits", "-o", "map").returncode == 0
    again = palpate("fit", "fits", "--thickness", "22 mm")
    assert "4 curves fitted" in again.stdout, again.stderr
    page = next(
        line for line in palpate("fit", "grid.csv", "--tip", "paraboloid 3 mm").stdout.splitlines() if "a page" in line
    )
    assert "device.log.record" in page
