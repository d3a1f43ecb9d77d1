"""The file of a study: a zip of the same bytes whenever it is packed, of which only plain files are unpacked."""

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
OPTIONS = ("by", "unit")  # of a report, which an archive may set
FITS, CURVES, FILES = "fits", "curves", "files"  # folders of an archive
_DATE = (1980, 1, 1, 0, 0, 0)  # of every member: the first that a zip can hold
_UNIX = 3  # the system that made a member, in the zip format
_FILE_MODE = (stat.S_IFREG | 0o644) << 16  # a regular file that everybody may read, in the upper half of the attributes
_ENCRYPTED = 0x1  # bit of a member's flags, in the zip format
# Bounds against archives that fill a disk, choices.
_MAX_MEMBERS = 200_000
_MAX_BYTES = 1 << 35  # unpacked, of all members
_MAX_RATIO = 200  # of the bytes unpacked to those packed; tables of numbers are at 3 to 10
_MIN_RATED_BYTES = 1 << 20  # unpacked, up to which the ratio does not matter
_NAME = re.compile(r"[^\x00-\x1f\x7f\\]{1,255}")  # of a file or folder
_MAX_SHOWN_NAME = 200  # characters, a choice: a few lines
_CHUNK = 1 << 20  # [bytes] copied at once, a choice


@dataclass(frozen=True)
class Manifest:
    """The document of an archive: versions, options and hashes."""

    versions: Mapping[str, str]  # of the libraries that made its pages and rows
    options: Mapping[str, str]  # of its report
    files: Mapping[str, str]  # SHA-256 by member
    left_out: Mapping[str, str] = field(default_factory=dict)  # SHA-256 by member of curves that are not in it

    @property
    def text(self) -> str:
        """The manifest as JSON."""
        return json.dumps({"format": FORMAT, **self.__dict__}, indent=2, sort_keys=True) + "\n"


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def files_below(root: Path) -> dict[str, Path]:
    """Return every file below a folder by its name as a member, in order; raises OutputError for a link."""
    files = {path.relative_to(root).as_posix(): path for path in root.rglob("*") if not path.is_dir()}
    for name, path in files.items():
        if path.is_symlink() or not path.is_file():
            raise OutputError(f"{name}: is not a regular file, and cannot be packed")
    return dict(sorted(files.items()))


def write_archive(root: Path, path: Path) -> None:
    """Pack all files below a folder: names in order, one date, no owner; raises OutputError."""
    with whole_file(path, binary=True) as file, ZipFile(file, "w", ZIP_DEFLATED, compresslevel=9) as archive:
        for name, source in files_below(root).items():
            info = ZipInfo(name, _DATE)
            info.create_system = _UNIX
            info.external_attr = _FILE_MODE
            info.compress_type = ZIP_DEFLATED
            info.file_size = source.stat().st_size
            with source.open("rb") as content, archive.open(info, "w") as member:
                shutil.copyfileobj(content, member, _CHUNK)
    _demand_unpackable(path)


def _demand_unpackable(path: Path) -> None:
    """Delete an archive that would not be unpacked, and raise OutputError."""
    try:
        with _open_archive(path) as archive:
            _plain_members(path, archive)
    except LogError as error:
        path.unlink()
        raise OutputError(str(error)) from error


def unpack(path: Path, root: Path) -> Manifest:
    """Unpack an archive into an empty folder, and nothing outside it; raises LogError for what palpate did not pack."""
    with _open_archive(path) as archive:
        for info in _plain_members(path, archive):
            target = root.joinpath(*PurePosixPath(info.filename).parts)
            try:
                target.parent.mkdir(parents=True, exist_ok=True)
                with archive.open(info) as member, target.open("xb") as file:
                    shutil.copyfileobj(member, file, _CHUNK)
            except OSError as error:
                raise LogError(f"{path}: {info.filename!r} cannot be unpacked: {error.strerror or error}") from error
    # Every file is in the manifest, with its hash, and the other way round.
    manifest = _read_manifest(path, root / MANIFEST)
    files = {name: file for name, file in files_below(root).items() if name != MANIFEST}
    for name in sorted({*files, *manifest.files}):
        if name not in files:
            raise LogError(f"{path}: {name}: is missing")
        if name not in manifest.files:
            raise LogError(f"{path}: {name}: is not of the study")
        if digest_of(files[name]) != manifest.files[name]:
            raise LogError(f"{path}: {name}: was changed after it was packed (SHA-256)")
    return manifest


@contextmanager
def _open_archive(path: Path) -> Iterator[ZipFile]:
    """Open an archive; raises LogError for a file that is not a zip, and for a damaged one while it is read."""
    if not path.is_file():
        raise LogError(f"{path}: {'is not a regular file' if path.exists() else 'no such file'}")
    try:
        with ZipFile(path) as archive:
            yield archive
    except (BadZipFile, zlib.error, EOFError, ValueError, OverflowError, NotImplementedError, RuntimeError) as error:
        raise LogError(f"{path}: is not an archive of a study, or a damaged one: {error}") from error
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror or error}") from error


def _plain_members(path: Path, archive: ZipFile) -> Sequence[ZipInfo]:
    """Return the members, all of them plain files of bounded size within the archive's own folders; raises LogError."""
    members = [info for info in archive.infolist() if not info.is_dir()]
    if len(members) > _MAX_MEMBERS:
        raise LogError(f"{path}: has {len(members)} members; at most {_MAX_MEMBERS} are unpacked")
    names: set[str] = set()
    for info in archive.infolist():
        problem = _member_problem(info)
        if not problem and info.filename in names:
            problem = "is there twice"
        if problem:
            raise LogError(f"{path}: {info.filename[:_MAX_SHOWN_NAME]!r}: {problem}")
        names.add(info.filename)
    unpacked_size = sum(info.file_size for info in members)
    packed_size = sum(info.compress_size for info in members)
    # Members that share their packed bytes are together larger than the file.
    if unpacked_size > _MAX_BYTES or packed_size > path.stat().st_size:
        raise LogError(
            f"{path}: would be {unpacked_size} bytes unpacked from {packed_size}; at most {_MAX_BYTES} are unpacked, "
            "each once"
        )
    return members


def _member_problem(info: ZipInfo) -> str:
    """Return the reason for which a member is not unpacked; "" for a member that is."""
    name_problem = _name_problem(info.filename)
    if name_problem:
        return name_problem
    # The upper half of the attributes is the mode of a Unix file; 0 where another system made the archive.
    file_type = stat.S_IFMT(info.external_attr >> 16)
    if file_type not in (0, stat.S_IFDIR if info.is_dir() else stat.S_IFREG):
        return "is a link or a device, which no study has"
    if info.flag_bits & _ENCRYPTED or info.compress_type not in (ZIP_STORED, ZIP_DEFLATED):
        return "is encrypted, or packed in a way that is not read"
    if info.file_size > max(_MIN_RATED_BYTES, _MAX_RATIO * info.compress_size):
        sizes = f"would be {info.file_size} bytes unpacked from {info.compress_size}"
        return f"{sizes}: more than {_MAX_RATIO} times as many"
    return ""


def _name_problem(name: str) -> str:
    """Return the reason for which a name is not that of a member; "" for a name that is.

    Members are the manifest, and files and folders, whose names end in "/", below the folders of an archive.
    """
    parts = name.removesuffix("/").split("/")
    if any(part in (".", "..") or not _NAME.fullmatch(part) for part in parts):
        return "is not a name of a file within the archive"
    is_in_folder = len(parts) > 1 or name.endswith("/")
    is_allowed = parts[0] in (FITS, CURVES, FILES) if is_in_folder else name == MANIFEST
    return "" if is_allowed else f"is in none of {FITS}, {CURVES}, {FILES}"


def _read_manifest(path: Path, file: Path) -> Manifest:
    """Return the manifest in a file that was unpacked from an archive `path`; raises LogError for another document."""
    try:
        table = json_document(bounded_text(file))
        format_number = table["format"]
        if format_number != FORMAT:
            raise LogError(f"{path}: is of format {format_number!r}, and this palpate reads format {FORMAT}")
        manifest = Manifest(*(_demand_texts(table[name]) for name in ("versions", "options", "files", "left_out")))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise LogError(f"{path}: has no {MANIFEST} that palpate pack has written: {error!r}") from error
    for name in manifest.left_out:
        problem = _name_problem(name)
        if problem:
            raise LogError(f"{path}: {name[:_MAX_SHOWN_NAME]!r}: {problem}")
    unknown_options = set(manifest.options) - set(OPTIONS)
    if unknown_options:
        raise LogError(f"{path}: a report has no option {min(unknown_options)!r} that an archive may set")
    return manifest


def _demand_texts(table: Any) -> dict[str, str]:
    """Return a table of texts; raises ValueError for anything else."""
    if not isinstance(table, dict) or not all(isinstance(item, str) for item in table.values()):
        raise ValueError("must be a table of texts")
    return table
