"""A folder of fits with all that it was made from, under names that say nothing of the machine."""

from __future__ import annotations

import getpass
import json
import os
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
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

_HOMES = re.compile(r"^/(?:home|Users)/[^/]+/")
_TEXTS = (PROVENANCE, REVIEW, RIG, "history.csv")  # of a folder, that are packed with other names of curves


def write_study(folder: FitFolder, root: Path) -> None:
    """Write a folder of fits, its curves and what else it names below an empty folder.

    Raises ConfigurationError where rows are stale or curves have gone, OutputError where a path of this machine
    would stay.
    """
    _demand_complete(folder)
    _Study(folder, root).write()


def _demand_complete(folder: FitFolder) -> None:
    if old := sum(row.state != "current" for row in folder.rows):
        raise ConfigurationError(
            f"{folder.path}: {old} rows are not of the present settings: palpate fit {folder.path}"
        )
    for name in folder.names:
        file = folder.file_of(name)
        if not file or not Path(file).exists():
            raise ConfigurationError(f"{folder.path / LIST}: {name}: its file is not known, or has gone: {file or '?'}")


@dataclass(frozen=True)
class _Study:
    folder: FitFolder
    root: Path

    def write(self) -> None:
        fits = self.root / FITS
        fits.mkdir(parents=True)
        for source, member in self.members.items():
            _copy(source, self.root / member)
        settings = without_curves_folder(toml_tables(bounded_text(self.folder.path / SETTINGS)))
        write_whole(fits / SETTINGS, tomli_w.dumps(self._with_members(settings)))
        entries = self.folder.entries
        lines = {self.names[name]: {**cells, FILE: self._seen(self._file(name))} for name, cells in entries.items()}
        write_list(fits / LIST, lines)
        own = {self.names[name]: [self._assignment(text) for text in texts] for name, texts in self.folder.own.items()}
        write_own(fits, own)
        for name in _TEXTS:
            if (self.folder.path / name).is_file():
                write_whole(fits / name, self._anonymous(bounded_text(self.folder.path / name)))
        self._write_rows(fits)
        self._demand_anonymous(fits.iterdir())

    def _write_rows(self, fits: Path) -> None:
        written = FitFolder(fits)
        rows = [
            {**row, "curve": (name := self.names[row["curve"]]), "settings": written.key(name),
             "error": row["error"].replace(row["curve"], name)}
            for curve in self.folder.names for row in self.folder.by_curve[curve]
        ]  # fmt: skip
        write_rows(fits / TABLE, columns_in(self.folder.path / TABLE), rows)

    @cached_property
    def members(self) -> dict[Path, str]:
        """Every file, or folder of a bag, next to the folder of fits, and where it is in the archive."""
        curves = dict.fromkeys(map(self._file, self.folder.names))
        found = _members(curves, CURVES)
        others = [path for path in self._files_of_settings() if path not in found]
        return found | _members(dict.fromkeys(others), FILES)

    @cached_property
    def names(self) -> dict[str, str]:
        """The names of the curves, those that are paths of this machine by their places in the archive."""
        found = {}
        for name in self.folder.names:
            file = self._file(name)
            member = self.members[file].removeprefix(f"{CURVES}/")
            found[name] = f"{member}{name.rpartition(file.name)[2]}" if os.path.isabs(name) else name
        if len({*found.values()}) < len(found):
            raise ConfigurationError(f"{self.folder.path}: two curves would have one name without their folders")
        return found

    def _file(self, curve: str) -> Path:
        return Path(self.folder.file_of(curve))

    def _files_of_settings(self) -> Iterator[Path]:
        yield from self._files_in(toml_tables(bounded_text(self.folder.path / SETTINGS)))
        for texts in self.folder.own.values():
            for text in texts:
                yield from self._files_in(parsed_assignment(text)[1])

    def _files_in(self, value: Any) -> Iterator[Path]:
        """Yield the files that settings name."""
        if isinstance(value, str) and (file := self._file_of(value)) is not None:
            yield file
        for item in value.values() if isinstance(value, Mapping) else value if isinstance(value, list) else ():
            yield from self._files_in(item)

    def _file_of(self, text: str) -> Path | None:
        with suppress(OSError, ValueError):  # a text that is not a path
            path = Path(os.path.normpath(self.folder.path.resolve() / text))
            if path.is_file() or (path.exists() and path in {*map(self._file, self.folder.names)}):
                return path
        return None

    def _with_members(self, value: Any) -> Any:
        """Settings with the place in the archive for each file that they name."""
        if isinstance(value, Mapping):
            return {key: self._with_members(item) for key, item in value.items()}
        if isinstance(value, list):
            return [self._with_members(item) for item in value]
        file = self._file_of(value) if isinstance(value, str) else None
        return value if file is None else self._seen(file)

    def _assignment(self, text: str) -> str:
        _, value = parsed_assignment(text)
        if (other := self._with_members(value)) == value:
            return text
        return f"{text.partition('=')[0]}={json.dumps(other)}"

    def _seen(self, file: Path) -> str:
        """Return a file as seen from the folder of fits in the archive."""
        return f"../{self.members[file]}"

    def _anonymous(self, text: str) -> str:
        """Return a text without the names of folders of this machine."""
        for old, new in self.names.items():
            text = text.replace(old, new) if old != new else text
        for file, member in self.members.items():
            text = text.replace(str(file), member)
        for place in self._places:
            text = text.replace(f"{place}/", "").replace(place, ".")
        return text

    @cached_property
    def _places(self) -> list[str]:
        """Folders of this machine, the longest first."""
        files = [self.folder.path.resolve(), self.folder.path.absolute(), *self.members]
        places = {str(place) for path in files for place in path.parents} | {os.getcwd(), str(Path.home())}
        return sorted((place for place in places if place.count("/") > 1 or place == str(Path.home())), key=len)[::-1]

    def _demand_anonymous(self, paths: Iterable[Path]) -> None:
        user = getpass.getuser()
        for path in paths:
            text = path.read_text(encoding="utf-8", errors="replace")
            known = [place for place in self._places if f"{place}/" in text]
            if known or re.search(rf"/(?:home|Users)/|/{re.escape(user)}/", text):
                raise OutputError(
                    f"{path.name}: names a folder of this machine, and is not packed: {known[:1] or user}"
                )


def _members(files: Iterable[Path], folder: str) -> dict[Path, str]:
    """Where files are in the archive: in one folder, below what they have in common, and no home is named."""
    short: Callable[[Path], PurePosixPath] = lambda path: PurePosixPath(_HOMES.sub("", str(path)).lstrip("/"))  # noqa: E731
    places = {path: short(path) for path in files}
    if not places:
        return {}
    common = os.path.commonpath([str(place.parent) for place in places.values()])
    found = {path: f"{folder}/{place.relative_to(common)}" for path, place in places.items()}
    if len({*found.values()}) < len(found):
        raise ConfigurationError("files of two homes would have one name in the archive: put them into one folder")
    return found


def _copy(source: Path, target: Path) -> None:
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        (shutil.copytree if source.is_dir() else shutil.copyfile)(source, target)
    except OSError as error:
        raise OutputError(f"{source}: cannot be packed: {error.strerror or error}") from error
