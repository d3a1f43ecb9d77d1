"""One test over the kinds of files that are read: whatever is damaged in one is one error that names it."""

import builtins
import csv
import errno
import io
import json
import os
import shutil
import threading
from pathlib import Path

import numpy as np
import pytest

from tests import result_documents
from tests.records import damage
from tests.records.bags import array_message, write_bag
from tests.surfaces import bodies

TIP = ("--tip", "paraboloid 3 mm")
BODY = """
[surface.body]
type = "mesh"
file = "{name}"
unit = "mm"
"""


def press(n=400):
    """Time [s], force [N] and height [mm] of a press on some 100 kPa."""
    time = np.arange(n) / 250
    depth = 4e-3 * np.sin(np.pi * time / time[-1]) - 1e-3
    force = 16 / 9 * 1e5 * np.sqrt(3e-3) * np.maximum(depth, 0.0) ** 1.5
    return np.column_stack([time, force + 0.02 * np.random.default_rng(1).standard_normal(n), -1e3 * depth])


def text(path):
    np.savetxt(path, press(), delimiter=",", header="time_s,force_N,height_mm", comments="")


def workbook(path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in (["time_s", "force_N", "height_mm"], *press().tolist()):
        book.active.append(row)
    book.save(path)


def mesh(path):
    bodies.write_body(path, *bodies.half(*bodies.ellipsoid(2)))


def result(path):
    document = result_documents.result({"dr/ekf": result_documents.track()})
    path.write_text(json.dumps(document))


def fits(path):
    result(path)
    document = {"logs": {"one": json.loads(path.read_text())}, "evaluation": [], "cycles": []}
    path.write_text(json.dumps(document))


def bag(path):
    message = [(10 * i, array_message([i, i * i])) for i in range(100)]
    write_bag(path, [("/a", "std_msgs/msg/Float64MultiArray", message)])


MADE = {  # name of a file: what writes it, and a command that reads it
    "a.csv": (text, ("info", "a.csv", "--suggest")),
    "a.csv.gz": (text, ("info", "a.csv.gz", "--suggest")),
    "a.xlsx": (workbook, ("info", "a.xlsx", "--suggest")),
    "a.mcap": (lambda path: path.write_bytes(damage.write("zstd", 300)), ("info", "a.mcap")),
    "a.db3": (bag, ("info", "a.db3")),
    "a.obj": (mesh, ("check", "body.toml")),
    "a.stl": (mesh, ("check", "body.toml")),
    "a.ply": (mesh, ("check", "body.toml")),
    "result.json": (result, ("repeat", "result.json", "--json")),
    "fit.json": (fits, ("repeat", "fit.json", "--json")),
}
FOLDER = {  # files of a folder of fits, and a command that reads them
    "fits.csv": ("repeat", "out", "--json"),
    "conditions.csv": ("repeat", "out", "--json"),
    "curves.csv": ("repeat", "out", "--json"),
    "review.json": ("repeat", "out", "--json"),
    "own.toml": ("fit", "out", "--set", "alignment.tip_mass=1 g", "--no-refit"),
    "pipeline.toml": ("fit", "out", "--set", "alignment.tip_mass=1 g", "--no-refit"),
}
QUICK = ("a.csv", "a.obj", "result.json")
NAMES = [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in (*MADE, *FOLDER)]
TORN = [name for name in NAMES if "fits.csv" not in str(name)]  # whose torn end is left out
ROWS = [name for name in NAMES if any(f"{end}'" in repr(name) for end in (".csv", ".obj"))]


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """A folder of fits with a mark, groups, and settings of one curve."""
    from tests.command import call

    folder = tmp_path_factory.mktemp("fitted")
    for name in ("0.csv", "1.csv"):
        text(folder / name)
    assert call("fit", ".", *TIP, "--out", "out", cwd=folder).returncode == 0
    assert call("repeat", "review", "out", "--reject", "0.csv", "--reason", "slipped", cwd=folder).returncode == 0
    own = ("--where", "1.csv", "--set", "estimator.fit.segment=load", "--no-refit")
    assert call("fit", "out", *own, cwd=folder).returncode == 0
    return folder


@pytest.fixture
def file(request, tmp_path, root):
    """A function that makes a file by its name, and returns it with the command that reads it."""

    def make(name):
        if name in FOLDER:
            shutil.copytree(request.getfixturevalue("fitted"), tmp_path, dirs_exist_ok=True)
            return tmp_path / "out" / name, FOLDER[name]
        write, command = MADE[name]
        write(tmp_path / name)
        if command[0] == "check":
            (tmp_path / "body.toml").write_text(
                (root / "pipelines" / "filters.toml").read_text() + BODY.format(name=name)
            )
        return tmp_path / name, command

    return make


def assert_clear(done, path, must=False):
    """Read as if nothing were wrong, where nothing shows it; else one error that names the file."""
    assert done.returncode in ((2,) if must else (0, 2)), done.stderr
    assert "Traceback" not in done.stderr
    assert "this is a bug" not in done.stderr
    if done.returncode == 2:
        assert path.name in done.stderr
        assert sum(line.startswith("palpate: ") for line in done.stderr.splitlines()) == 1


@pytest.mark.parametrize("name", NAMES)
def test_a_whole_file_is_read(file, palpate, name):
    _, command = file(name)
    done = palpate(*command)
    assert done.returncode == 0, done.stderr


def flip(raw, seed):
    """Up to sixteen bits, anywhere."""
    random = np.random.default_rng(seed)
    found = bytearray(raw)
    for at in random.integers(0, len(raw), int(random.integers(1, 17))):
        found[at] ^= 1 << int(random.integers(0, 8))
    return bytes(found)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_bits_that_are_flipped(file, palpate, name):
    path, command = file(name)
    raw = path.read_bytes()
    for seed in range(25 if name == "a.xlsx" else 10):
        path.write_bytes(flip(raw, seed))
        assert_clear(palpate(*command), path)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 0.99])
@pytest.mark.parametrize("name", TORN)
def test_an_end_that_is_missing(file, palpate, name, share):
    path, command = file(name)
    raw = path.read_bytes()
    path.write_bytes(raw[: int(share * len(raw))])
    assert_clear(palpate(*command), path)


@pytest.mark.parametrize("row", [0, 1, 2])
@pytest.mark.parametrize("name", ROWS)
def test_a_row_that_lacks_cells(file, palpate, name, row):
    path, command = file(name)
    lines = path.read_text().splitlines()
    cut = lines[row].split("," if path.suffix == ".csv" else " ")[0]
    path.write_text("\n".join([*lines[:row], cut, *lines[row + 1 :], ""]))
    assert_clear(palpate(*command), path, must=name == "fits.csv")


@pytest.mark.parametrize("name", NAMES)
def test_deep_nesting(file, palpate, name):
    path, command = file(name)
    head = "a = " if path.suffix == ".toml" else ""
    path.write_text(head + "[" * 100_000)
    assert_clear(palpate(*command), path, must=name != "a.mcap")


@pytest.mark.parametrize("kind", ["pipe", "endless", "folder"])
@pytest.mark.parametrize("name", NAMES)
def test_what_is_no_regular_file(file, palpate, name, kind):
    """A pipe would be waited for, a device without an end would fill the memory."""
    path, command = file(name)
    path.unlink()
    if kind == "pipe":
        os.mkfifo(path)
        waiting = threading.Timer(60.0, ended, [path])  # of whoever waits for it
        waiting.start()
        done = palpate(*command)
        assert waiting.is_alive(), "the pipe was waited for"
        waiting.cancel()
    else:
        path.mkdir() if kind == "folder" else path.symlink_to("/dev/zero")
        done = palpate(*command)
    assert_clear(done, path)


def ended(path):
    """Let whoever reads a pipe see its end."""
    os.close(os.open(path, os.O_WRONLY | os.O_NONBLOCK))


def test_materials_beside_a_mesh_are_not_opened(file, palpate):
    """One that is a pipe would be waited for."""
    path, command = file("a.obj")
    path.write_text(f"mtllib pipe.mtl\nusemtl skin\n{path.read_text()}")
    os.mkfifo(path.with_name("pipe.mtl"))
    waiting = threading.Timer(60.0, ended, [path.with_name("pipe.mtl")])
    waiting.start()
    done = palpate(*command)
    assert waiting.is_alive(), "the pipe was waited for"
    waiting.cancel()
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_dialect_that_a_table_of_curves_names_is_no_file(file, palpate, tmp_path):
    path, command = file("curves.csv")
    with path.open(newline="") as text:
        rows = list(csv.DictReader(text))
    with path.open("w", newline="") as text:
        table = csv.DictWriter(text, list(rows[0]))
        table.writeheader()
        table.writerows(row | {"dialect": "/dev/zero"} for row in rows)
    done = palpate(*command)
    assert_clear(done, path, must=True)
    assert "no dialect '/dev/zero'" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        ("fit", "out"),
        ("fit", "out", "--set", "alignment.tip_mass=1 g"),
        ("fit", "0.csv", *TIP),
        ("fit", ".", *TIP, "--out", "b/c"),
    ],
)
def test_a_disk_that_is_read_only(fitted, tmp_path, palpate, monkeypatch, command):
    """One error that names what cannot be written."""
    shutil.copytree(fitted, tmp_path, dirs_exist_ok=True)
    rows = (tmp_path / "out" / "fits.csv").read_text().splitlines()
    (tmp_path / "out" / "fits.csv").write_text("\n".join([*rows, "0.cs"]))  # torn in writing, to be cut
    refuse_writing(monkeypatch, tmp_path)
    done = palpate(*command)
    assert done.returncode == 2, done.stderr
    assert [line for line in done.stderr.splitlines() if line.startswith("palpate: ")] == [done.stderr.strip()]
    assert "cannot write: Read-only file system" in done.stderr or "cannot make" in done.stderr


def refuse_writing(monkeypatch, folder):
    """Answer as a disk that is read-only, to whoever writes below a folder: as root, permissions refuse nothing."""

    def refused(real, writes):
        def call(path, *arguments, **keywords):
            inside = isinstance(path, str | Path) and Path(path).absolute().is_relative_to(folder)
            if inside and writes(*arguments, **keywords):
                raise OSError(errno.EROFS, "Read-only file system", str(path))
            return real(path, *arguments, **keywords)

        return call

    def by_mode(mode="r", *_, **keywords):
        return bool(set(keywords.get("mode", mode)) & set("wax+"))

    for module, name, writes in (
        (builtins, "open", by_mode),
        (io, "open", by_mode),
        (os, "mkdir", lambda *_, **__: True),
        (os, "truncate", lambda *_, **__: True),
    ):
        monkeypatch.setattr(module, name, refused(getattr(module, name), writes))
