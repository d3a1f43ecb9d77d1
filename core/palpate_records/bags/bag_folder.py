"""A rosbag2 bag: a folder with ``metadata.yaml`` and one or more files, or one of those files."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from functools import cached_property
from itertools import chain, islice, pairwise
from pathlib import Path

import numpy as np
from palpate import LogError, printable

from palpate_records.bags.sqlite_bag import SqliteBag, unpacked_rows
from palpate_records.log_files import regular
from palpate_records.mcap.mcap_file import McapFile
from palpate_records.messages.topic_kinds import named_by_kind
from palpate_records.messages.topics import Container, Messages, Topic

_METADATA = 1 << 24  # [bytes] of metadata.yaml that are read
_NAMES = 1 << 20  # characters of a list of files
_NAMED = 5  # parts
_BESIDE = ("-wal", "-shm", "-journal", ".toml", ".yaml", ".md")  # what may lie next to the files of a bag
_SETTINGS = "pipeline.toml"  # in the folder of a run, whose log is all of it that is read
_PAUSE = 1_000_000_000  # [ns] between the parts of one recording, at most
SUFFIXES = (".db3", ".db3.gz", ".db3.zstd", ".db3.zst", ".mcap")


class Bag:
    """The files of a bag, one after another."""

    def __init__(self, path: Path, accept_cut: bool = False) -> None:
        self.path = path
        self.files = bag_files(path)
        self._packed = path.is_dir() and _setting(path / "metadata.yaml", "compression_mode").lower() == "message"
        self._parts: list[Container] = [
            McapFile(file, accept_cut) if file.name.endswith(".mcap") else SqliteBag(file, self._packed)
            for file in self.files
        ]

    @property
    def complete(self) -> bool:
        """True if every file has its end."""
        return all(part.complete for part in self._parts if isinstance(part, McapFile))

    @property
    def trouble(self) -> str | None:
        """What is wrong with any of the files."""
        troubles = [part.trouble for part in self._parts]
        lost = _lost(self.files) if self.path.is_dir() and not _listed(self.path / "metadata.yaml") else None
        return "; ".join(text for text in (lost, *troubles) if text) or None

    @property
    def topics(self) -> Mapping[str, Topic]:
        """The topics of all files."""
        found: dict[str, Topic] = {}
        for topic in self._topics.values():
            found.setdefault(topic.name, topic)
        return found

    @cached_property
    def _topics(self) -> Mapping[tuple[int, str], Topic]:
        """Those of each file, by its number and the name there."""
        parts = enumerate(self._parts)
        return named_by_kind({(i, name): topic for i, part in parts for name, topic in part.topics.items()})

    @property
    def span(self) -> tuple[int, int] | None:
        """First and last log time [ns] of all files."""
        spans = [part.span for part in self._parts]
        known = [span for span in spans if span is not None]
        return (min(span[0] for span in known), max(span[1] for span in known)) if known else None

    def blocks(
        self, wanted: Set[str], begin: int | None = None, end: int | None = None
    ) -> Iterator[tuple[str, Messages]]:
        """Messages of the requested topics, file after file."""
        for i, part in enumerate(self._parts):
            names = {name: self._topics[i, name].name for name in part.topics}
            present = {name for name in names if names[name] in wanted}
            for name, messages in part.blocks(present, begin, end) if present else ():
                packed = self._packed and isinstance(part, McapFile)
                yield from ((names[name], some) for some in (self._unpacked(messages) if packed else (messages,)))

    def _unpacked(self, messages: Messages) -> Iterator[Messages]:
        """Messages that were compressed one by one, a few at a time."""
        rows = [(0, row, messages.payload(row)) for row in range(len(messages))]
        try:
            for some in unpacked_rows(rows):
                kept = np.array([row for _, row, _ in some])
                yield Messages.joined([raw for _, _, raw in some], messages.logged[kept], messages.published[kept])
        except sqlite3.DatabaseError as error:
            raise LogError(f"{self.path}: {error}") from error


def bag_files(path: Path) -> list[Path]:
    """Return the files of a bag in their order: as ``metadata.yaml`` lists them, else by name."""
    if not _is(Path.is_dir, path):
        return [regular(path)]
    listed = _listed(path / "metadata.yaml")
    present = [path / Path(name).name for name in listed]
    missing = [file.name for file in present if not _is(Path.is_file, file)]
    if missing:
        named = printable(", ".join(missing))
        raise LogError(
            f"{path}: metadata.yaml lists {named if len(named) < 200 else named[:200] + ' ...'}, which "
            f"{'is' if len(missing) == 1 else 'are'} not there; without metadata.yaml the other files are read"
        )
    if present:
        return present
    found = [file for file in path.iterdir() if file.name.lower().endswith(SUFFIXES)]
    if not found:
        raise LogError(f"{path}: no bag: there is neither a metadata.yaml that lists files nor a .db3 or .mcap file")
    return sorted(found, key=_number)


def is_bag(path: Path) -> bool:
    """Whether a folder is one bag: it has metadata, or nothing but one file, or numbered parts of one set of topics.

    Each part begins where the one before it ends; numbered logs that are records by themselves do not. Of the folder
    of a run its log counts alone.
    """
    if not _is(Path.is_dir, path):
        return False
    if (path / "metadata.yaml").is_file():
        return True
    files = [file for file in path.iterdir() if not file.name.startswith(".") and not file.name.endswith(_BESIDE)]
    if (path / _SETTINGS).is_file():
        files = [file for file in files if file.name.lower().endswith(SUFFIXES)]
    if not files or not all(file.name.lower().endswith(SUFFIXES) and file.is_file() for file in files):
        return False
    return len(files) == 1 or (len({_number(file)[0] for file in files}) == 1 and _go_on(sorted(files, key=_number)))


def _go_on(files: Sequence[Path]) -> bool:
    """Return True if files with consecutive numbers have the same topics, and go on where the one before ends."""
    try:
        bags = [Bag(file, accept_cut=True) for file in files]
        topics = [{(topic.name, topic.type) for topic in bag.topics.values()} for bag in bags]
        spans = [bag.span for bag in bags]
    except LogError:
        return False
    pairs = [k for k in range(1, len(files)) if _number(files[k])[1] == _number(files[k - 1])[1] + 1]
    return bool(pairs) and all(topics[k] == topics[k - 1] and _follows(spans[k], spans[k - 1]) for k in pairs)


def _follows(span: tuple[int, int] | None, before: tuple[int, int] | None) -> bool:
    return span is not None and before is not None and before[0] < span[0] and span[0] - before[1] < _PAUSE


def _lost(files: Sequence[Path]) -> str | None:
    """Return the parts that are missing between those of a bag without metadata, in words; None where none is."""
    if len({_number(file)[0] for file in files}) > 1:
        return None
    gaps = (range(_number(one)[1] + 1, _number(other)[1]) for one, other in pairwise(files))
    first = list(islice(chain.from_iterable(gaps), _NAMED + 1))
    named = ", ".join(map(str, first[:_NAMED])) + (", ..." if len(first) > _NAMED else "")
    parts = f"part{'s' if len(first) > 1 else ''} {named} of {printable(_number(files[0])[0])}"
    return f"{parts} not there" if first else None


def _is(kind: Callable[[Path], bool], path: Path) -> bool:
    try:
        return kind(path)
    except (OSError, ValueError):  # a name that no file can have
        return False


def _number(file: Path) -> tuple[str, int]:
    """Split files are numbered: bag_2 comes before bag_10."""
    stem = file.name.split(".db3")[0].split(".mcap")[0]
    name = stem.rstrip("0123456789")
    digits = stem[len(name) :][-18:]
    return name.removesuffix("_"), int(digits or 0)


def _lines(metadata: Path) -> list[str]:
    """Return a bag's metadata; none where missing, as after a crash: its files suffice."""
    try:
        with metadata.open("rb") as file:
            return file.read(_METADATA).decode().splitlines()
    except (OSError, UnicodeDecodeError):
        return []


def _listed(metadata: Path) -> list[str]:
    """``relative_file_paths``, whose two spellings of a list are all the YAML that is needed here."""
    words = (line.strip() for line in _lines(metadata))
    names: list[str] = []
    for line in words:
        if not line.startswith("relative_file_paths:"):
            continue
        inline = line.partition(":")[2].strip()
        if inline.startswith("["):
            text = inline
            while "]" not in text and (more := next(words, None)) is not None:
                text = f"{text} {more}" if len(text) < _NAMES else f"{text}]"
            names = text[1:].partition("]")[0].split(",")
        else:
            for item in words:
                if item and not item.startswith("-"):
                    break
                names += [item[1:]] if item else []
        break
    return [name.strip().strip("\"'") for name in names if name.strip()]


def _setting(metadata: Path, key: str) -> str:
    found = (line.partition(":")[2] for line in _lines(metadata) if line.strip().startswith(f"{key}:"))
    return next(found, "").strip().strip("\"'")
