"""A folder of fits with all that it was made from, under names without folders or users of this machine."""

from __future__ import annotations

import getpass
import json
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any

import tomli_w
from palpate import ConfigurationError, OutputError
from palpate_engine import RIG, bounded_text, parsed_assignment, toml_tables, write_whole
from palpate_kit.curves.curve_list import FILE, LIST, write_list
from palpate_kit.curves.curve_table import TABLE, columns_in, write_rows
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.curves.fit_provenance import PROVENANCE
from palpate_kit.curves.folder_settings import SETTINGS, without_curves_folder
from palpate_kit.curves.own_settings import write_own
from palpate_kit.runs.review_file import REVIEW

from palpate_studies.archive.archive_file import CURVES, FILES, FITS

_HOME = re.compile(r"^/(?:home|Users)/[^/]+/")
_TEXT_FILES = (PROVENANCE, REVIEW, RIG, "history.csv")  # of a folder of fits, packed with other names of curves


def write_study(folder: FitFolder, root: Path) -> None:
    """Write a folder of fits, its curves and the files that its settings name below an empty folder.

    Raises ConfigurationError if rows are stale or curves are missing, OutputError if a path of this machine would stay.
    """
    _demand_complete(folder)
    _Study(folder, root).write()


def _demand_complete(folder: FitFolder) -> None:
    """Raise ConfigurationError for rows that are not of the present settings, and for a curve without its file."""
    stale_count = sum(row.state != "current" for row in folder.rows)
    if stale_count:
        raise ConfigurationError(
            f"{folder.path}: {stale_count} rows are not of the present settings: palpate fit {folder.path}"
        )
    for name in folder.names:
        file = folder.file_of(name)
        if not file or not Path(file).exists():
            raise ConfigurationError(f"{folder.path / LIST}: {name}: its file is not known, or has gone: {file or '?'}")


@dataclass(frozen=True)
class _Study:
    """A folder of fits, and the empty folder below which it is written."""

    folder: FitFolder
    root: Path

    def write(self) -> None:
        """Write everything; raises ConfigurationError, OutputError."""
        fits = self.root / FITS
        fits.mkdir(parents=True)
        for source, member in self.members.items():
            _copy(source, self.root / member)
        # Settings and the list of curves, with the files in the archive.
        settings = without_curves_folder(toml_tables(bounded_text(self.folder.path / SETTINGS)))
        write_whole(fits / SETTINGS, tomli_w.dumps(self._with_members(settings)))
        entries: dict[str, dict[str, str]] = {}
        for name, cells in self.folder.entries.items():
            entries[self.names[name]] = {**cells, FILE: self._relative_member(self._file(name))}
        write_list(fits / LIST, entries)
        own_settings: dict[str, list[str]] = {}  # by curve
        for name, assignments in self.folder.own.items():
            own_settings[self.names[name]] = [self._packed_assignment(assignment) for assignment in assignments]
        write_own(fits, own_settings)
        for name in _TEXT_FILES:
            if (self.folder.path / name).is_file():
                write_whole(fits / name, self._anonymous(bounded_text(self.folder.path / name)))
        # Rows name the settings that were written.
        self._write_rows(fits)
        self._demand_anonymous(fits.iterdir())

    def _write_rows(self, fits: Path) -> None:
        """Write the table of fits, with the names of curves and settings in the folder that was written."""
        written_folder = FitFolder(fits)
        rows = []
        for curve in self.folder.names:
            name = self.names[curve]
            for row in self.folder.by_curve[curve]:
                error = row["error"].replace(row["curve"], name)
                rows.append({**row, "curve": name, "settings": written_folder.key(name), "error": error})
        write_rows(fits / TABLE, columns_in(self.folder.path / TABLE), rows)

    @cached_property
    def members(self) -> dict[Path, str]:
        """The name in the archive of every file, or folder of a bag, that is a curve or that settings name."""
        curve_files = dict.fromkeys(self._file(name) for name in self.folder.names)
        curve_members = _members(curve_files, CURVES)
        other_files = dict.fromkeys(path for path in self._files_of_settings() if path not in curve_members)
        return curve_members | _members(other_files, FILES)

    @cached_property
    def names(self) -> dict[str, str]:
        """The name of each curve in the archive, of one that is a path of this machine by its file there."""
        names: dict[str, str] = {}
        for name in self.folder.names:
            file = self._file(name)
            member = self.members[file].removeprefix(f"{CURVES}/")
            record = name.rpartition(file.name)[2]  # behind the file, of a file of several
            names[name] = f"{member}{record}" if os.path.isabs(name) else name
        if len({*names.values()}) < len(names):
            raise ConfigurationError(f"{self.folder.path}: two curves would have one name without their folders")
        return names

    def _file(self, curve: str) -> Path:
        """Return the file of a curve."""
        return Path(self.folder.file_of(curve))

    def _files_of_settings(self) -> Iterator[Path]:
        """Yield the files that the settings of the folder and those of its curves name."""
        yield from self._files_in(toml_tables(bounded_text(self.folder.path / SETTINGS)))
        for assignments in self.folder.own.values():
            for assignment in assignments:
                _, setting = parsed_assignment(assignment)
                yield from self._files_in(setting)

    def _files_in(self, setting: Any) -> Iterator[Path]:
        """Yield the files that a setting names, or those of a table or list."""
        if isinstance(setting, str):
            file = self._named_file(setting)
            if file is not None:
                yield file
        elif isinstance(setting, Mapping):
            for item in setting.values():
                yield from self._files_in(item)
        elif isinstance(setting, list):
            for item in setting:
                yield from self._files_in(item)

    def _named_file(self, text: str) -> Path | None:
        """Return the file, or bag of a curve, that a text names relative to the folder of fits; None for any other."""
        with suppress(OSError, ValueError):  # a text that is not a path
            path = Path(os.path.normpath(self.folder.path.resolve() / text))
            if path.is_file() or (path.exists() and path in {*map(self._file, self.folder.names)}):
                return path
        return None

    def _with_members(self, setting: Any) -> Any:
        """Return a setting, table or list with the name in the archive in place of each file."""
        if isinstance(setting, Mapping):
            return {key: self._with_members(item) for key, item in setting.items()}
        if isinstance(setting, list):
            return [self._with_members(item) for item in setting]
        file = self._named_file(setting) if isinstance(setting, str) else None
        return setting if file is None else self._relative_member(file)

    def _packed_assignment(self, text: str) -> str:
        """Return an assignment "KEY=VALUE" with the names in the archive in place of files."""
        _, setting = parsed_assignment(text)
        packed_setting = self._with_members(setting)
        if packed_setting == setting:
            return text
        return f"{text.partition('=')[0]}={json.dumps(packed_setting)}"

    def _relative_member(self, file: Path) -> str:
        """Return the name of a file in the archive, relative to the folder of fits there."""
        return f"../{self.members[file]}"

    def _anonymous(self, text: str) -> str:
        """Return a text with names in the archive in place of curves and files, and without folders of this machine."""
        for name, packed_name in self.names.items():
            if name != packed_name:
                text = text.replace(name, packed_name)
        for file, member in self.members.items():
            text = text.replace(str(file), member)
        for folder in self._local_folders:
            text = text.replace(f"{folder}/", "").replace(folder, ".")
        return text

    @cached_property
    def _local_folders(self) -> list[str]:
        """The folders of this machine above any file, the longest first; of those at the root the home alone."""
        files = [self.folder.path.resolve(), self.folder.path.absolute(), *self.members]
        home = str(Path.home())
        folders = {str(parent) for file in files for parent in file.parents} | {os.getcwd(), home}
        return sorted((folder for folder in folders if folder.count("/") > 1 or folder == home), key=len)[::-1]

    def _demand_anonymous(self, paths: Iterable[Path]) -> None:
        """Raise OutputError for a file whose text names a folder or the user of this machine."""
        user = getpass.getuser()
        for path in paths:
            text = path.read_text(encoding="utf-8", errors="replace")
            named_folders = [folder for folder in self._local_folders if f"{folder}/" in text]
            if named_folders or re.search(rf"/(?:home|Users)/|/{re.escape(user)}/", text):
                raise OutputError(
                    f"{path.name}: names a folder of this machine, and is not packed: {named_folders[:1] or user}"
                )


def _members(files: Iterable[Path], folder: str) -> dict[Path, str]:
    """Return the names of files in the archive: in one of its folders, below the folder that they have in common.

    A home is not part of a name. Raises ConfigurationError for two files that would have one name.
    """
    short_paths = {path: PurePosixPath(_HOME.sub("", str(path)).lstrip("/")) for path in files}
    if not short_paths:
        return {}
    common_folder = os.path.commonpath([str(short.parent) for short in short_paths.values()])
    members = {path: f"{folder}/{short.relative_to(common_folder)}" for path, short in short_paths.items()}
    if len({*members.values()}) < len(members):
        raise ConfigurationError("files of two homes would have one name in the archive: put them into one folder")
    return members


def _copy(source: Path, target: Path) -> None:
    """Copy a file or a folder; raises OutputError."""
    copy = shutil.copytree if source.is_dir() else shutil.copyfile
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        copy(source, target)
    except OSError as error:
        raise OutputError(f"{source}: cannot be packed: {error.strerror or error}") from error
