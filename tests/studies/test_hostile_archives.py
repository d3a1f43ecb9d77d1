"""Strangers' archives: nothing of them leaves the folder in which they are unpacked, and no more than its size."""

import json
import os
import stat
import zipfile
from pathlib import Path

import pytest
from palpate_studies.archive.archive_file import unpack
from palpate_studies.archive.row_differences import row_differences

from tests.studies.study_folder import members, packed

CONTENTS = {
    "curves/a.csv": bytes(range(256)) * 8,
    "fits/fits.csv": b"curve,track\n",
    "study.json": json.dumps({"format": 1, "versions": {}, "options": {}, "files": {}, "left_out": {}}).encode(),
}


def well(place):
    """Contents of an archive whose hashes fit."""
    return members(packed(place / "well.zip", CONTENTS))


def test_an_archive_is_unpacked_as_it_was_packed(tmp_path):
    unpack(packed(tmp_path / "well.zip", CONTENTS), tmp_path / "root")
    found = {
        path.relative_to(tmp_path / "root").as_posix() for path in (tmp_path / "root").rglob("*") if path.is_file()
    }
    assert found == set(CONTENTS)
    assert (tmp_path / "root" / "curves" / "a.csv").read_bytes() == CONTENTS["curves/a.csv"]


def zip_of(path, *entries, **details):
    """A zip of names, or of infos of members, with one content."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for entry in entries:
            archive.writestr(entry, details.get("content", b"x"))
    return path


def special(name, mode):
    info = zipfile.ZipInfo(name)
    info.external_attr = mode << 16
    return info


HOSTILE_NAMES = [
    "../evil", "fits/../../evil", "/etc/evil", "fits//evil", "fits/./evil", "fits\\..\\evil", "C:/evil", "evil",
    "fits/a\x1b[2Jb", "other/evil", "fits/" + "a" * 300, "fits", "curves/..",
]  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE_NAMES)
def test_no_member_leaves_the_archive(palpate, tmp_path, name):
    done = palpate("verify", zip_of(tmp_path / "evil.zip", name))
    assert done.returncode == 2
    assert "is not a name of a file within the archive" in done.stderr or "is in none of" in done.stderr
    assert "\x1b" not in done.stderr
    assert not [path for path in tmp_path.rglob("evil") if path.name == "evil"]
    assert not Path("/etc/evil").exists()


@pytest.mark.parametrize("mode", [stat.S_IFLNK, stat.S_IFCHR, stat.S_IFIFO, stat.S_IFSOCK, stat.S_IFBLK])
def test_a_link_or_a_device_is_refused(palpate, tmp_path, mode):
    done = palpate(
        "verify", zip_of(tmp_path / "evil.zip", special("fits/fits.csv", mode | 0o777), content=b"/etc/passwd")
    )
    assert (done.returncode, "is a link or a device" in done.stderr) == (2, True)


def bomb(place):
    return zip_of(place / "evil.zip", "fits/fits.csv", content=b"\0" * (1 << 24))


def twice(place):
    with pytest.warns(UserWarning, match="Duplicate"):
        return zip_of(place / "evil.zip", "fits/fits.csv", "fits/fits.csv")


def overlapping(place):
    """Many members of the central directory that are one run of bytes: a bomb without any ratio."""
    path = zip_of(place / "evil.zip", "curves/a", content=os.urandom(1 << 16))
    with zipfile.ZipFile(path, "a") as archive:
        first = archive.infolist()[0]
        for i in range(64):
            other = zipfile.ZipInfo(f"curves/b{i}")
            for key in ("header_offset", "compress_size", "file_size", "CRC", "compress_type"):
                setattr(other, key, getattr(first, key))
            archive.filelist.append(other)
            archive._didModify = True
    return path


def encrypted(place):
    content = bytearray(zip_of(place / "evil.zip", "fits/fits.csv").read_bytes())
    for sign, at in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        content[content.index(sign) + at] |= 1
    (place / "evil.zip").write_bytes(content)
    return place / "evil.zip"


def packed_by_lzma(place):
    with zipfile.ZipFile(place / "evil.zip", "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("fits/fits.csv", b"x" * 1000)
    return place / "evil.zip"


def damaged(place):
    content = bytearray(packed(place / "evil.zip", CONTENTS).read_bytes())
    content[50:90] = bytes(40)
    (place / "evil.zip").write_bytes(content)
    return place / "evil.zip"


def torn(place):
    (place / "evil.zip").write_bytes(packed(place / "evil.zip", CONTENTS).read_bytes()[:300])
    return place / "evil.zip"


def file_below_a_file(place):
    return zip_of(place / "evil.zip", "fits/a", "fits/a/b")


def no_manifest(place):
    return zip_of(place / "evil.zip", "fits/fits.csv")


def newer(place):
    manifest = CONTENTS["study.json"].replace(b'"format": 1', b'"format": 2')
    return packed(place / "evil.zip", {**CONTENTS, "study.json": manifest})


def changed(place):
    return packed(place / "evil.zip", {**well(place), "fits/fits.csv": b"other"}, manifest=False)


def one_more(place):
    return packed(place / "evil.zip", {**well(place), "files/more.py": b"x"}, manifest=False)


def with_manifest(key, value):
    def make(place):
        manifest = json.dumps({**json.loads(CONTENTS["study.json"]), key: value}).encode()
        return packed(place / "evil.zip", {**CONTENTS, "study.json": manifest})

    return make


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (bomb, "more than 200 times as many"),
        (twice, "is there twice"),
        (overlapping, "each once"),
        (encrypted, "is encrypted"),
        (packed_by_lzma, "packed in a way that is not read"),
        (damaged, "a damaged one"),
        (torn, "a damaged one"),
        (file_below_a_file, "cannot be unpacked"),
        (no_manifest, "has no study.json"),
        (newer, "is of format 2, and this palpate reads format 1"),
        (changed, "fits/fits.csv: was changed after it was packed"),
        (one_more, "files/more.py: is not of the study"),
        (with_manifest("options", {"out": "/tmp/evil.html"}), "no option 'out'"),
        (with_manifest("options", ["by"]), "has no study.json that palpate pack has written"),
        (with_manifest("left_out", {"../../evil": "0" * 64}), "is not a name of a file within the archive"),
    ],
)
def test_an_archive_that_palpate_has_not_packed_is_refused_by_name(palpate, tmp_path, make, told):
    done = palpate("verify", make(tmp_path))
    assert done.returncode == 2, done.stdout
    assert "evil.zip" in done.stderr
    assert told in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("what", ["nothing.zip", "folder"])
def test_what_is_no_file_is_named(palpate, tmp_path, what):
    (tmp_path / "folder").mkdir()
    done = palpate("verify", what)
    assert (done.returncode, what in done.stderr) == (2, True)


def test_a_folder_with_something_in_it_is_not_written_to(palpate, tmp_path):
    packed(tmp_path / "well.zip", CONTENTS)
    done = palpate("verify", "well.zip", "--out", ".")
    assert (done.returncode, "is not empty" in done.stderr) == (2, True)
    assert [path.name for path in tmp_path.iterdir()] == ["well.zip"]


def test_a_number_that_is_another_is_told_in_its_uncertainty():
    old = {"curve": "a", "track": "t", "elasticity": "1000.0", "elasticity_combined": "20.0", "verdict": "good"}
    found = list(row_differences([old], [{**old, "elasticity": "1005.0", "verdict": "doubtful"}]))
    assert [(one.column, one.in_u) for one in found] == [("elasticity", pytest.approx(0.25)), ("verdict", None)]
    assert [one.found for one in row_differences([old], [])] == ["none"]
