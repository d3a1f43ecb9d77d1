"""A rosbag2 bag: a folder with ``metadata.yaml`` and one or more files, or one of those files."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Set
from functools import cached_property
from pathlib import Path

from palpate import LogError

from palpate_devices.logs.mcap_file import McapFile
from palpate_devices.logs.sqlite_bag import SqliteBag
from palpate_devices.logs.topics import Container, Messages, Topic

SUFFIXES = (".db3", ".db3.gz", ".db3.zstd", ".db3.zst", ".mcap")


class Bag:
    """The files of a bag, one after another."""

    def __init__(self, path: Path, accept_cut: bool = False) -> None:
        self.path = path
        self.files = bag_files(path)
        packed = path.is_dir() and _setting(path / "metadata.yaml", "compression_mode").lower() == "message"
        self._parts: list[Container] = [
            McapFile(file, accept_cut) if file.name.endswith(".mcap") else SqliteBag(file, packed)
            for file in self.files
        ]

    @property
    def complete(self) -> bool:
        """Whether every file has its end."""
        return all(part.complete for part in self._parts if isinstance(part, McapFile))

    @property
    def trouble(self) -> str | None:
        """What is amiss with any of the files."""
        return "; ".join(part.trouble for part in self._parts if part.trouble) or None

    @property
    def topics(self) -> Mapping[str, Topic]:
        """The topics of all files."""
        return self._topics

    @cached_property
    def _topics(self) -> Mapping[str, Topic]:
        found: dict[str, Topic] = {}
        for part in self._parts:
            for name, topic in part.topics.items():
                if found.setdefault(name, topic).type != topic.type:
                    raise LogError(f"{self.path}: topic {name} changes its type from one file to the next")
        return found

    @property
    def span(self) -> tuple[int, int] | None:
        """First and last log time [ns] of all files."""
        spans = [part.span for part in self._parts]
        known = [span for span in spans if span is not None]
        return (min(span[0] for span in known), max(span[1] for span in known)) if known else None

    def blocks(
        self, wanted: Set[str], begin: int | None = None, end: int | None = None
    ) -> Iterator[tuple[str, Messages]]:
        """Messages of the wanted topics, file after file."""
        for part in self._parts:
            present = {name for name in wanted if name in part.topics}
            if present:
                yield from part.blocks(present, begin, end)


def bag_files(path: Path) -> list[Path]:
    """The files of a bag in their order: as ``metadata.yaml`` lists them, else by name."""
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise LogError(f"{path}: there is no such file or folder")
    listed = _listed(path / "metadata.yaml")
    present = [path / Path(name).name for name in listed]
    missing = [file.name for file in present if not file.is_file()]
    if missing:
        raise LogError(
            f"{path}: metadata.yaml lists {', '.join(missing)}, which {'is' if len(missing) == 1 else 'are'} not there"
        )
    if present:
        return present
    found = [file for file in path.iterdir() if file.name.endswith(SUFFIXES)]
    if not found:
        raise LogError(f"{path}: no bag: there is neither a metadata.yaml that lists files nor a .db3 or .mcap file")
    return sorted(found, key=_number)


def _number(file: Path) -> tuple[str, int]:
    """Split files are numbered: bag_2 comes before bag_10."""
    match = re.search(r"^(.*?)_?(\d+)?\.(?:db3|mcap)", file.name)
    return (match[1], int(match[2] or 0)) if match else (file.name, 0)


def _text(metadata: Path) -> str:
    try:
        return metadata.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""  # a bag after a crash has none: its files say enough


def _listed(metadata: Path) -> list[str]:
    """``relative_file_paths``, whose two spellings of a list are all the YAML that is needed here."""
    text = _text(metadata)
    inline = re.search(r"^\s*relative_file_paths:\s*\[(.*?)\]", text, re.MULTILINE | re.DOTALL)
    if inline:
        names = inline[1].split(",")
    else:
        block = re.search(r"^\s*relative_file_paths:\s*\n((?:\s*-\s*[^\n]+\n?)+)", text, re.MULTILINE)
        names = re.findall(r"-\s*([^\n]+)", block[1]) if block else []
    return [name.strip().strip("\"'") for name in names if name.strip()]


def _setting(metadata: Path, key: str) -> str:
    match = re.search(rf"^\s*{key}:\s*(.*)$", _text(metadata), re.MULTILINE)
    return match[1].strip().strip("\"'") if match else ""
