"""Files of arrays as tables: the numbers to the bit, several records, and files that claim, hide or link too much."""

import itertools
import json

import numpy as np
import pytest
from palpate import LogError
from palpate_logs.csv_replay import CsvReplay
from palpate_logs.csv_roles import read_sheet, suggest_csv
from palpate_records import decompression
from palpate_records.tables.array_files import array_tables
from palpate_records.tables.array_table import MAX_NUMBERS, demand_readable_size, tables_of
from palpate_records.tables.table_records import records_in
from scipy.io import savemat

TIME = np.arange(200) / 100.0
DEPTH = np.interp(TIME, [0.0, 0.5, 1.5, 2.0], [-0.5, -0.5, 1.0 / 3.0, 1.0 / 3.0])
FORCE = np.maximum(DEPTH, 0.0) ** 1.5 + 1e-3 * np.random.default_rng(1).standard_normal(200)
COLUMNS = {"time_s": TIME, "depth_mm": DEPTH, "force_N": FORCE}
OBJECT = [{"time_s": t, "depth_mm": d, "force_N": f} for t, d, f in zip(TIME, DEPTH, FORCE, strict=True)]


def write_npz(path, **arrays):
    np.savez(path, **arrays)
    return path


def write_json(path, document):
    path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize(
    "document",
    [
        {name: list(values) for name, values in COLUMNS.items()},
        {"press": {"data": {name: list(values) for name, values in COLUMNS.items()}, "rate": 100}, "by": "A. B."},
        OBJECT,
        {"rows": OBJECT},
        {"columns": [*COLUMNS], "data": np.column_stack([*COLUMNS.values()]).tolist()},
        {name: {str(k): value for k, value in enumerate(values)} for name, values in COLUMNS.items()},
    ],
    ids=["columns", "nested", "objects", "objects by name", "split", "by row"],
)
def test_columns_of_json_are_read_to_the_bit(tmp_path, document):
    looked = read_sheet(write_json(tmp_path / "press.json", document), {})
    assert looked.sheet.names == (*COLUMNS,)
    np.testing.assert_array_equal(looked.values, np.column_stack([*COLUMNS.values()]))


def test_objects_of_a_message_are_columns_of_one_table(tmp_path):
    """A list of messages with force and pose in objects of their own was three tables, none of them a press."""
    messages = [
        {"t": t, "wrench": {"force": {"x": 0.0, "z": f}}, "pose": {"x": 0.4, "z": z}}
        for t, z, f in zip(TIME, DEPTH, FORCE, strict=True)
    ]
    (table,) = array_tables(write_json(tmp_path / "log.json", {"messages": messages}))
    assert [*table.columns] == ["t", "wrench.force.x", "wrench.force.z", "pose.x", "pose.z"]


def test_trials_whose_messages_are_in_groups_are_records(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "trials.h5", "w") as file:
        for trial, group, axis in itertools.product(("trial1", "trial2"), ("wrench", "pose"), "xyz"):
            file[f"{trial}/{group}/{axis}"] = np.arange(30.0)
    tables = array_tables(tmp_path / "trials.h5")
    assert [table.name for table in tables] == ["trial1", "trial2"]
    assert "wrench.z" in tables[0].columns


@pytest.mark.parametrize("document", [{"E": 1.0, "files": ["a", "b"]}, [1, 2, 3], {}, "x", [[1, 2], [3]], [{}, {}, {}]])
def test_a_json_without_columns_is_no_table(tmp_path, document):
    path = write_json(tmp_path / "result.json", document)
    assert not CsvReplay.recognises(path)
    with pytest.raises(LogError, match=r"result\.json: the file contains no columns of numbers"):
        array_tables(path)


def test_a_result_of_palpate_is_no_table(tmp_path):
    """A folder of a run holds one log; its result has lists as long as a record."""
    course = {name: list(values) for name, values in COLUMNS.items()}
    path = write_json(tmp_path / "result.json", {"schema": 1, "palpate": "0.2", "tracks": course})
    assert not CsvReplay.recognises(path)
    assert not CsvReplay.recognises(write_json(tmp_path / "list.json", {"source": ["a"] * 9, "std": [1.0] * 9}))


def test_arrays_of_numpy_are_read_to_the_bit_and_single_values_are_facts(tmp_path):
    looked = read_sheet(write_npz(tmp_path / "press.npz", **COLUMNS, rate=250.0), {})
    np.testing.assert_array_equal(looked.values, np.column_stack([*COLUMNS.values()]))
    assert [(fact.name, fact.value) for fact in looked.sheet.facts] == [("rate", "250.0")]


def test_missing_numbers_durations_and_truths_are_read(tmp_path):
    arrays = {
        "time": (1e9 * TIME).astype("timedelta64[ns]"),
        "z_mm": np.where(TIME == 0.5, np.nan, DEPTH),
        "force_N": FORCE,
        "contact": FORCE > 0.1,
    }
    values = read_sheet(write_npz(tmp_path / "press.npz", **arrays), {}).values
    np.testing.assert_allclose(values[:, 0], TIME)
    assert np.isnan(values[50, 1])
    np.testing.assert_array_equal(values[:, 3], FORCE > 0.1)


def test_groups_with_the_same_names_are_records(tmp_path):
    groups = {f"gel {k}": {name: k * values for name, values in COLUMNS.items()} for k in (1, 2)}
    path = tmp_path / "gels.mat"
    savemat(path, {name.replace(" ", "_"): fields for name, fields in groups.items()})
    assert [record.name for record in records_in(path)] == ["gel_1", "gel_2"]
    np.testing.assert_array_equal(read_sheet(path, {"record": "gel_2"}).values[:, 2], 2 * FORCE)


def test_arrays_of_other_lengths_are_another_table(tmp_path):
    tables = tables_of([*(((name,), values) for name, values in COLUMNS.items()), (("short",), TIME[:9])], "press")
    assert [(table.name, [*table.columns]) for table in tables] == [("press", [*COLUMNS])]


@pytest.mark.parametrize("suffix", [".npz", ".mat", ".parquet"])
def test_what_log_export_writes_is_read_again(tmp_path, palpate, suffix):
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    table = tmp_path / "press.csv"
    np.savetxt(table, np.column_stack([*COLUMNS.values()]), "%.9g", ",", header=",".join(COLUMNS), comments="")
    out = tmp_path / f"again{suffix}"
    done = palpate("log", "export", str(table), "-o", str(out))
    assert not done.returncode, done.stderr
    columns = suggest_csv(out, {}).device["columns"]
    names = [columns[role]["column"].rpartition(":")[2] for role in ("force", "position")]
    assert names == ["force_N", "depth_mm"]


@pytest.fixture
def small_room(monkeypatch):
    """Files may unpack to 200 times their size, without the 64 MiB that are small enough whatever the ratio."""
    monkeypatch.setattr(decompression, "_SMALL_SIZE", 0)


@pytest.mark.usefixtures("small_room")
def test_an_archive_that_unpacks_to_far_more_is_refused(tmp_path):
    path = tmp_path / "zeros.npz"
    np.savez_compressed(path, x=np.zeros(1 << 18))
    with pytest.raises(LogError, match="unpacks to more than a file of its size does"):
        array_tables(path)


@pytest.mark.usefixtures("small_room")
def test_the_elements_of_a_mat_file_are_unpacked_within_bounds(tmp_path):
    path = tmp_path / "zeros.mat"
    savemat(path, {"x": np.zeros(1 << 18)}, do_compression=True)
    with pytest.raises(LogError, match="unpacks to more than a file of its size does"):
        array_tables(path)


@pytest.mark.parametrize("numbers", [-1, MAX_NUMBERS + 1, 10**20])
def test_more_numbers_than_are_read_are_refused(numbers):
    with pytest.raises(ValueError, match="10 million are read"):
        demand_readable_size(numbers)


def test_an_array_that_was_cut_is_refused(tmp_path):
    np.save(tmp_path / "cut.npy", np.column_stack([*COLUMNS.values()]))
    raw = (tmp_path / "cut.npy").read_bytes()
    (tmp_path / "cut.npy").write_bytes(raw[:-80])
    with pytest.raises(LogError, match="is longer than the file: it was cut"):
        array_tables(tmp_path / "cut.npy")


def test_no_object_of_an_archive_is_loaded(tmp_path):
    class Trap:
        def __reduce__(self):
            return (open, (str(tmp_path / "trap"), "w"))

    np.savez(tmp_path / "trap.npz", time=TIME, force=np.array([Trap()] * 20, dtype=object), allow_pickle=True)
    with pytest.raises(LogError, match="never read since they may run code"):
        array_tables(tmp_path / "trap.npz")
    assert not (tmp_path / "trap").exists()


def test_links_into_other_files_are_not_followed(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["force"] = FORCE
    with h5py.File(tmp_path / "link.h5", "w") as file:
        file["time"], file["depth"] = TIME, DEPTH
        file["force"] = h5py.ExternalLink("other.h5", "/force")
        file["again"] = h5py.SoftLink("/")
    (table,) = array_tables(tmp_path / "link.h5")
    assert sorted(table.columns) == ["depth", "time"]


def test_a_curve_of_a_microscope_in_hdf5_is_no_table(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "curve.h5"
    with h5py.File(path, "w") as file:
        file.attrs["software"], file.attrs["software version"] = "afmformats", "0.18"
        for name, values in COLUMNS.items():
            file[f"0/{name}"] = values
    assert not CsvReplay.recognises(path)


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".mat", ".h5", ".parquet", ".feather", ".json"])
@pytest.mark.parametrize("content", [b"", b"\0" * 300, b"PK\x03\x04" + b"\xff" * 300, b"\x93NUMPY\x01\x00\xff\xff{"])
def test_what_is_no_such_file_is_refused_in_a_line(tmp_path, suffix, content):
    if suffix in (".h5", ".parquet", ".feather"):
        pytest.importorskip({".h5": "h5py"}.get(suffix, "pyarrow"))
    path = tmp_path / f"broken{suffix}"
    path.write_bytes(content)
    with pytest.raises(LogError) as refusal:
        array_tables(path)
    assert path.name in str(refusal.value)
    assert len(str(refusal.value).splitlines()) == 1
