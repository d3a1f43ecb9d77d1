"""A folder of fits of few curves of four animals in two groups, made once, and its archive."""

import csv
import json
import shutil
import zipfile

import numpy as np

from tests.command import call
from tests.curves.conftest import TIP, press

NAMES = [f"{group}/{animal}_{i}.csv" for group in ("control", "treated") for animal in "abc" for i in range(2)]


def made(folder, names=NAMES):
    """Curves in folders of their groups, the folder `fits`, and a table of groups and animals."""
    for i, name in enumerate(names):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        treated = path.parent.name == "treated"
        table = press(i, 1e5 * (1.0 + 0.2 * treated + 0.03 * (i % 3)), n=250)
        np.savetxt(path, table, delimiter=",", header="time_s,force_N,height_mm", comments="", fmt="%.9g")
    done = call("fit", "control", "treated", *TIP, "--out", "fits", "--jobs", "1", cwd=folder)
    assert done.returncode == 0, done.stderr
    rows = [f"{name},{name.split('/')[0]},{name[0]}-{name.split('/')[1][0]}" for name in names]
    (folder / "groups.csv").write_text("\n".join(["curve,treatment,animal", *rows]) + "\n")
    assert call("fit", "fits", "--groups", "groups.csv", "--no-refit", cwd=folder).returncode == 0
    done = call("repeat", "review", "fits", "--reject", names[1], "--reason", "the tip slipped", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


def members(path):
    """Content by name."""
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def packed(path, contents, manifest=True):
    """An archive of contents by name, with SHA-256 of them in its study.json unless that is to stay as it is."""
    import hashlib

    if manifest:
        known = json.loads(contents["study.json"])
        known["files"] = {
            name: hashlib.sha256(content).hexdigest() for name, content in contents.items() if name != "study.json"
        }
        contents = {**contents, "study.json": json.dumps(known).encode()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in contents.items():
            archive.writestr(name, content)
    return path


def rows_of(content):
    """Rows of a table of fits."""
    return list(csv.DictReader(content.decode().splitlines()))


def copied(folder, target):
    """A copy of a folder with everything in it."""
    shutil.copytree(folder, target, dirs_exist_ok=True)
    return target
