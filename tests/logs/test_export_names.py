"""`palpate log export`: names of topics and fields that fall together in a file are kept apart."""

import csv

import numpy as np
import pytest
from palpate_logs.table_files import WRITERS
from palpate_logs.topic_arrays import TEXTS, TopicFiles

from tests.records.bags import array_message, write_bag

ALIKE = {  # topics whose names fall together where "/" or all but letters is not allowed
    "/ft/raw": [1.0, 2.0],
    "/ft_raw": [3.0],
    "/ft.raw": [4.0, 5.0, 6.0],
    "ft/raw": [7.0],
    "/ft_raw_2": [8.0],
    f"/{'long' * 20}/a": [9.0],
    f"/{'long' * 20}/b": [10.0],
}


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".mat", ".parquet"])
def test_topics_whose_names_fall_together_are_kept_apart(palpate, tmp_path, suffix):
    kind = "std_msgs/msg/Float64MultiArray"
    topics = [(name, kind, [(i, array_message([x])) for i, x in enumerate(xs)]) for name, xs in ALIKE.items()]
    write_bag(tmp_path / "bag.db3", topics)
    if suffix == ".parquet":
        pytest.importorskip("pyarrow", reason="parquet needs pyarrow")
    done = palpate("log", "export", "bag.db3", "-o", f"x{suffix}")
    assert done.returncode == 0, done.stderr
    found = sorted(tuple(x for x in column if x == x) for column in columns_of(tmp_path / f"x{suffix}"))
    assert found == sorted(map(tuple, ALIKE.values()))
    if suffix == ".mat":
        assert "topic /ft_raw is ft_raw_3 in x.mat: another one has its name there" in done.stderr


def columns_of(path):
    """The columns of data in a file that was exported."""
    if path.suffix == ".npz":
        with np.load(path) as arrays:
            return [arrays[name].tolist() for name in arrays if "data[0]" in name]
    if path.suffix == ".mat":
        from scipy.io import loadmat

        structs = loadmat(path)
        return [value["data_0"][0, 0].ravel().tolist() for name, value in structs.items() if not name.startswith("__")]
    if path.suffix == ".parquet":
        from pyarrow import parquet

        table = parquet.read_table(path)
        return [table.column(k).to_pylist() for k, name in enumerate(table.column_names) if "data[0]" in name]
    with path.open() as file:
        columns = [*zip(*csv.reader(file), strict=True)]
    return [[float(cell) if cell else np.nan for cell in cells] for name, *cells in columns if "data[0]" in name]


def test_fields_and_time_stamps_whose_names_fall_together_are_kept_apart(tmp_path):
    """Of one topic, its texts too, and across topics in a table."""
    files = {}
    for key, topic, names, words in (
        ("/a", "/a", ("b:c", "x.y", "x_y", "stamp_ns"), ()),
        ("/a:b", "/a:b", ("c",), ()),
        ("/a" + TEXTS, "/a", ("x.y",), (("soft", "hard"),)),
    ):
        files[key] = TopicFiles(topic, names, tmp_path / str(len(files)), words)
        stamps = np.arange(1 + len(words))
        files[key].append(stamps, np.zeros((len(stamps), len(names))))
    for suffix in (".csv", ".npz"):
        WRITERS[suffix](tmp_path / f"x{suffix}", files)
    with (tmp_path / "x.csv").open() as file:
        rows = list(csv.reader(file))
    assert len(set(rows[0])) == len(rows[0]) == 2 + 6
    assert [len(row) for row in rows] == [8, 8, 8]
    with np.load(tmp_path / "x.npz") as arrays:
        assert len(arrays.files) == 3 + 6
        assert arrays["a:stamp_ns"].tolist() == [0]
