"""The file of a study: a zip of the same bytes whenever it is packed, and of a stranger nothing but plain files."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import stat
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any
from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile, ZipInfo

from palpate import LogError, OutputError
from palpate_engine import bounded_text, json_document, whole_file

MANIFEST = "study.json"
FORMAT = 1
OPTIONS = ("by", "unit")  # of a report
FITS, CURVES, FILES = "fits", "curves", "files"  # folders of an archive
_DATE = (1980, 1, 1, 0, 0, 0)  # of every member: the first that a zip can hold
_MOST = 200_000  # members
_LARGEST = 1 << 35  # [bytes] unpacked
_RATIO = 200  # of the bytes unpacked to those packed; tables of numbers are at 3 to 10
_SMALL = 1 << 20  # [bytes] whose ratio does not matter
_NAME = re.compile(r"[^\x00-\x1f\x7f\\]{1,255}")  # of a file or folder
_CHUNK = 1 << 20  # [bytes]


@dataclass(frozen=True)
class Manifest:
    """What an archive says of itself."""

    versions: Mapping[str, str]  # that its pages and rows were made with
    options: Mapping[str, str]  # of its report
    files: Mapping[str, str]  # SHA-256 by member
    left_out: Mapping[str, str] = field(default_factory=dict)  # the same of curves that are not in it

    @property
    def text(self) -> str:
        """As JSON."""
        return json.dumps({"format": FORMAT, **self.__dict__}, indent=2, sort_keys=True) + "\n"


def digest_of(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def files_below(root: Path) -> dict[str, Path]:
    """Return every file below a folder by its name as a member, in order; raises OutputError for a link."""
    found = {path.relative_to(root).as_posix(): path for path in root.rglob("*") if not path.is_dir()}
    for name, path in found.items():
        if path.is_symlink() or not path.is_file():
            raise OutputError(f"{name}: is not a regular file, and cannot be packed")
    return dict(sorted(found.items()))


def write_archive(root: Path, path: Path) -> None:
    """Pack all files below a folder: names in order, one date, no owner; raises OutputError."""
    with whole_file(path, binary=True) as file, ZipFile(file, "w", ZIP_DEFLATED, compresslevel=9) as archive:
        for name, source in files_below(root).items():
            info = ZipInfo(name, _DATE)
            info.create_system, info.external_attr, info.compress_type = 3, (stat.S_IFREG | 0o644) << 16, ZIP_DEFLATED
            info.file_size = source.stat().st_size
            with source.open("rb") as content, archive.open(info, "w") as member:
                shutil.copyfileobj(content, member, _CHUNK)
    _check(path)


def _check(path: Path) -> None:
    """Raise OutputError for an archive that would not be unpacked."""
    try:
        with _opened(path) as archive:
            _demand_plain(path, archive)
    except LogError as error:
        path.unlink()
        raise OutputError(str(error)) from error


def unpack(path: Path, root: Path) -> Manifest:
    """Unpack an archive into an empty folder, and nothing outside it; raises LogError for what palpate did not pack."""
    with _opened(path) as archive:
        for info in _demand_plain(path, archive):
            target = root.joinpath(*PurePosixPath(info.filename).parts)
            try:
                target.parent.mkdir(parents=True, exist_ok=True)
                with archive.open(info) as member, target.open("xb") as file:
                    shutil.copyfileobj(member, file, _CHUNK)
            except OSError as error:
                raise LogError(f"{path}: {info.filename!r} cannot be unpacked: {error.strerror or error}") from error
    manifest = _read_manifest(path, root / MANIFEST)
    there = {name: source for name, source in files_below(root).items() if name != MANIFEST}
    for name in sorted({*there, *manifest.files}):
        if name not in there or name not in manifest.files:
            raise LogError(f"{path}: {name}: {'is missing' if name not in there else 'is not of the study'}")
        if digest_of(there[name]) != manifest.files[name]:
            raise LogError(f"{path}: {name}: was changed after it was packed (SHA-256)")
    return manifest


@contextmanager
def _opened(path: Path) -> Iterator[ZipFile]:
    if not path.is_file():
        raise LogError(f"{path}: {'is not a regular file' if path.exists() else 'no such file'}")
    try:
        with ZipFile(path) as archive:
            yield archive
    except (BadZipFile, zlib.error, EOFError, ValueError, OverflowError, NotImplementedError, RuntimeError) as error:
        raise LogError(f"{path}: is not an archive of a study, or a damaged one: {error}") from error
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror or error}") from error


def _demand_plain(path: Path, archive: ZipFile) -> Sequence[ZipInfo]:
    """Return the members, all of them plain files of bounded size within the archive's own folders; raises LogError."""
    members = [info for info in archive.infolist() if not info.is_dir()]
    if len(members) > _MOST:
        raise LogError(f"{path}: has {len(members)} members; at most {_MOST} are unpacked")
    names: set[str] = set()
    for info in archive.infolist():
        if problem := _problem(info):
            raise LogError(f"{path}: {info.filename[:200]!r}: {problem}")
        if info.filename in names:
            raise LogError(f"{path}: {info.filename[:200]!r}: is there twice")
        names.add(info.filename)
    size, packed = sum(info.file_size for info in members), sum(info.compress_size for info in members)
    if size > _LARGEST or packed > path.stat().st_size:
        raise LogError(
            f"{path}: would be {size} bytes unpacked from {packed}; at most {_LARGEST} are unpacked, each once"
        )
    return members


def _problem(info: ZipInfo) -> str:
    """What is wrong with a member; "" where nothing is."""
    if wrong := _wrong_name(info.filename):
        return wrong
    kind = stat.S_IFMT(info.external_attr >> 16)
    if kind not in (0, stat.S_IFDIR if info.is_dir() else stat.S_IFREG):
        return "is a link or a device, which no study has"
    if info.flag_bits & 0x1 or info.compress_type not in (ZIP_STORED, ZIP_DEFLATED):
        return "is encrypted, or packed in a way that is not read"
    if info.file_size > max(_SMALL, _RATIO * info.compress_size):
        return f"would be {info.file_size} bytes unpacked from {info.compress_size}: more than {_RATIO} times as many"
    return ""


def _wrong_name(name: str) -> str:
    """Return why a name is not that of a file, or with a stroke at its end of a folder, of an archive; "" where it
    is one."""
    parts = name.removesuffix("/").split("/")
    if any(part in (".", "..") or not _NAME.fullmatch(part) for part in parts):
        return "is not a name of a file within the archive"
    if parts[0] not in (FITS, CURVES, FILES) if len(parts) > 1 or name.endswith("/") else name != MANIFEST:
        return f"is in none of {FITS}, {CURVES}, {FILES}"
    return ""


def _read_manifest(path: Path, file: Path) -> Manifest:
    try:
        table = json_document(bounded_text(file))
        known = table["format"]
        if known != FORMAT:
            raise LogError(f"{path}: is of format {known!r}, and this palpate reads format {FORMAT}")
        found = Manifest(*(_texts(table[name]) for name in ("versions", "options", "files", "left_out")))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise LogError(f"{path}: has no {MANIFEST} that palpate pack has written: {error!r}") from error
    for name in found.left_out:
        if problem := _wrong_name(name):
            raise LogError(f"{path}: {name[:200]!r}: {problem}")
    if unknown := set(found.options) - set(OPTIONS):
        raise LogError(f"{path}: a report has no option {min(unknown)!r} that an archive may set")
    return found


def _texts(table: Any) -> dict[str, str]:
    if not isinstance(table, dict) or not all(isinstance(item, str) for item in table.values()):
        raise ValueError("must be a table of texts")
    return table
