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

_METADATA = "metadata.yaml"
_SETTINGS = "pipeline.toml"  # in the folder of a run, of which only the log is read
_OTHER_ENDINGS = ("-wal", "-shm", "-journal", ".toml", ".yaml", ".md")  # of files next to those of a bag
SUFFIXES = (".db3", ".db3.gz", ".db3.zstd", ".db3.zst", ".mcap")
# Choices.
_MAX_METADATA = 1 << 24  # [bytes] of metadata.yaml that are read
_MAX_LIST = 1 << 20  # characters of a list of files
_MAX_SHOWN_PARTS = 5  # in a message
_MAX_SHOWN = 200  # characters of a list of files in a message
_MAX_PAUSE = 1_000_000_000  # [ns] between the parts of one recording
_MAX_DIGITS = 18  # of the number of a part


class Bag:
    """The files of a bag as one container."""

    def __init__(self, path: Path, accept_cut: bool = False) -> None:
        self.path = path
        self.files = bag_files(path)
        self._has_packed_messages = (
            path.is_dir() and _setting(path / _METADATA, "compression_mode").lower() == "message"
        )
        self._parts: list[Container] = [
            McapFile(file, accept_cut) if file.name.endswith(".mcap") else SqliteBag(file, self._has_packed_messages)
            for file in self.files
        ]

    @property
    def complete(self) -> bool:
        """True if every file has its end."""
        return all(part.complete for part in self._parts if isinstance(part, McapFile))

    @property
    def trouble(self) -> str | None:
        """A sentence on missing parts and on damage to any of the files; None without any."""
        troubles = [part.trouble for part in self._parts]
        has_list = not self.path.is_dir() or bool(_listed_files(self.path / _METADATA))
        missing_parts = None if has_list else _missing_parts(self.files)
        return "; ".join(text for text in (missing_parts, *troubles) if text) or None

    @property
    def topics(self) -> Mapping[str, Topic]:
        """The topics of all files."""
        topics: dict[str, Topic] = {}
        for topic in self._topics.values():
            topics.setdefault(topic.name, topic)
        return topics

    @cached_property
    def _topics(self) -> Mapping[tuple[int, str], Topic]:
        """The topics of each file, by its index and their names in it."""
        parts = enumerate(self._parts)
        return named_by_kind({(i, name): topic for i, part in parts for name, topic in part.topics.items()})

    @property
    def span(self) -> tuple[int, int] | None:
        """First and last log time [ns] of all files."""
        spans = [span for part in self._parts if (span := part.span) is not None]
        return (min(first for first, _ in spans), max(last for _, last in spans)) if spans else None

    def blocks(
        self, wanted: Set[str], begin: int | None = None, end: int | None = None
    ) -> Iterator[tuple[str, Messages]]:
        """Yield messages of the `wanted` topics with their topic, file after file, within [begin, end) [ns].

        A topic may have another name in one of the files. Messages that are compressed one by one are unpacked.
        """
        for i, part in enumerate(self._parts):
            names = {name: self._topics[i, name].name for name in part.topics}
            present_names = {name for name in names if names[name] in wanted}
            if not present_names:
                continue
            for name, messages in part.blocks(present_names, begin, end):
                if self._has_packed_messages and isinstance(part, McapFile):
                    for piece in self._unpack(messages):
                        yield names[name], piece
                else:
                    yield names[name], messages

    def _unpack(self, messages: Messages) -> Iterator[Messages]:
        """Yield messages that were compressed one by one, a few at a time; raises LogError."""
        rows = [(0, row, messages.payload(row)) for row in range(len(messages))]
        try:
            for unpacked in unpacked_rows(rows):
                indices = np.array([row for _, row, _ in unpacked])
                payloads = [payload for _, _, payload in unpacked]
                yield Messages.joined(payloads, messages.logged[indices], messages.published[indices])
        except sqlite3.DatabaseError as error:
            raise LogError(f"{self.path}: {error}") from error


def bag_files(path: Path) -> list[Path]:
    """Return the files of a bag in their order: as ``metadata.yaml`` lists them, else by name; raises LogError."""
    if not _holds(Path.is_dir, path):
        return [regular(path)]
    listed_files = [path / Path(name).name for name in _listed_files(path / _METADATA)]
    # A list is believed if all of its files are there.
    missing_names = [file.name for file in listed_files if not _holds(Path.is_file, file)]
    if missing_names:
        names = printable(", ".join(missing_names))
        names = names if len(names) < _MAX_SHOWN else f"{names[:_MAX_SHOWN]} ..."
        verb = "is" if len(missing_names) == 1 else "are"
        raise LogError(
            f"{path}: metadata.yaml lists {names}, which {verb} not there; without metadata.yaml the other files are "
            "read"
        )
    if listed_files:
        return listed_files
    files = [file for file in path.iterdir() if file.name.lower().endswith(SUFFIXES)]
    if not files:
        raise LogError(f"{path}: no bag: there is neither a metadata.yaml that lists files nor a .db3 or .mcap file")
    return sorted(files, key=_stem_and_number)


def is_bag(path: Path) -> bool:
    """Return True if a folder is one bag: it has metadata, or a single file, or numbered parts of one set of topics.

    Each part begins where the one before it ends; numbered logs that are records by themselves do not. In the folder
    of a run only logs count.
    """
    if not _holds(Path.is_dir, path):
        return False
    if (path / _METADATA).is_file():
        return True
    files = _relevant_files(path)
    if not files or not all(file.name.lower().endswith(SUFFIXES) and file.is_file() for file in files):
        return False
    if len(files) == 1:
        return True
    stems = {_stem_and_number(file)[0] for file in files}
    return len(stems) == 1 and _are_successive(sorted(files, key=_stem_and_number))


def _relevant_files(folder: Path) -> list[Path]:
    """Return the files of a folder without hidden ones and those that may lie next to a bag; of a run only its log."""
    files = []
    for file in folder.iterdir():
        if not file.name.startswith(".") and not file.name.endswith(_OTHER_ENDINGS):
            files.append(file)
    if (folder / _SETTINGS).is_file():
        return [file for file in files if file.name.lower().endswith(SUFFIXES)]
    return files


def _are_successive(files: Sequence[Path]) -> bool:
    """Return True if files with consecutive numbers have the same topics, and each begins where the one before ends."""
    try:
        bags = [Bag(file, accept_cut=True) for file in files]
        topics = [{(topic.name, topic.type) for topic in bag.topics.values()} for bag in bags]
        spans = [bag.span for bag in bags]
    except LogError:
        return False
    numbers = [_stem_and_number(file)[1] for file in files]
    successors = [k for k in range(1, len(files)) if numbers[k] == numbers[k - 1] + 1]
    if not successors:
        return False
    return all(topics[k] == topics[k - 1] and _follows(spans[k], spans[k - 1]) for k in successors)


def _follows(span: tuple[int, int] | None, span_before: tuple[int, int] | None) -> bool:
    """Return True if a span [ns] begins after another began, and soon after that ends."""
    if span is None or span_before is None:
        return False
    return span_before[0] < span[0] and span[0] - span_before[1] < _MAX_PAUSE


def _missing_parts(files: Sequence[Path]) -> str | None:
    """Return a sentence on the numbers that are missing between those of the files; None without gaps."""
    if len({_stem_and_number(file)[0] for file in files}) > 1:
        return None
    numbers = [_stem_and_number(file)[1] for file in files]
    gaps = (range(number + 1, next_number) for number, next_number in pairwise(numbers))
    missing = list(islice(chain.from_iterable(gaps), _MAX_SHOWN_PARTS + 1))
    if not missing:
        return None
    names = ", ".join(map(str, missing[:_MAX_SHOWN_PARTS])) + (", ..." if len(missing) > _MAX_SHOWN_PARTS else "")
    noun = "part" if len(missing) == 1 else "parts"
    return f"{noun} {names} of {printable(_stem_and_number(files[0])[0])} not there"


def _holds(condition: Callable[[Path], bool], path: Path) -> bool:
    """Return True if a condition holds for a path; False for a name that no file can have."""
    try:
        return condition(path)
    except (OSError, ValueError):
        return False


def _stem_and_number(file: Path) -> tuple[str, int]:
    """Return the name and the number of a part, by which bag_2 comes before bag_10; 0 without a number."""
    stem = file.name.split(".db3")[0].split(".mcap")[0]
    name = stem.rstrip("0123456789")
    digits = stem[len(name) :][-_MAX_DIGITS:]
    return name.removesuffix("_"), int(digits or 0)


def _lines(metadata: Path) -> list[str]:
    """Return the lines of a bag's metadata; none if it is missing, as after a crash: the files suffice."""
    try:
        with metadata.open("rb") as file:
            return file.read(_MAX_METADATA).decode().splitlines()
    except (OSError, UnicodeDecodeError):
        return []


def _listed_files(metadata: Path) -> list[str]:
    """Return ``relative_file_paths``, a list in either of its two spellings; no more of YAML is needed."""
    lines = (line.strip() for line in _lines(metadata))
    for line in lines:
        if line.startswith("relative_file_paths:"):
            inline_text = line.partition(":")[2].strip()
            names = _inline_items(inline_text, lines) if inline_text.startswith("[") else _block_items(lines)
            return [name.strip().strip("\"'") for name in names if name.strip()]
    return []


def _inline_items(text: str, lines: Iterator[str]) -> list[str]:
    """Return the items of a list "[a, b]" that begins with a text and may go on in further lines."""
    while "]" not in text and (line := next(lines, None)) is not None:
        text = f"{text} {line}" if len(text) < _MAX_LIST else f"{text}]"
    return text[1:].partition("]")[0].split(",")


def _block_items(lines: Iterator[str]) -> list[str]:
    """Return the items of a list whose lines begin with "-"."""
    items = []
    for line in lines:
        if line and not line.startswith("-"):
            break
        if line:
            items.append(line[1:])
    return items


def _setting(metadata: Path, key: str) -> str:
    """Return the value of a key; "" without one."""
    values = (line.partition(":")[2] for line in _lines(metadata) if line.strip().startswith(f"{key}:"))
    return next(values, "").strip().strip("\"'")
