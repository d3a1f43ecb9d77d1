"""Replay of a rosbag2 bag."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Self

from palpate import Batch, File, Link, LogError, Stream, Time
from palpate_kit.logs.joint_kinematics import Kinematics
from palpate_kit.logs.log_link import LogLink, described_feeds, file_facts, window
from palpate_kit.logs.topic_suggestion import suggestion_for
from palpate_kit.terminal.progress import report_progress
from palpate_records.bags.bag_folder import SUFFIXES, Bag, is_bag
from palpate_records.bags.sqlite_recovery import recover_bag
from palpate_records.log_tables import tables_of, texts_of
from palpate_records.messages.channel_mapping import Clock, MappedSignal
from palpate_records.messages.feeds import TopicFeed, untimed_note
from palpate_records.messages.topics import Container, Stamps
from palpate_records.recording import Recording, Suggestion, Survey
from palpate_records.survey import survey_of
from pydantic import Field, model_validator


class Rosbag2Replay(Recording):
    """A rosbag2 bag as a device: a ``.db3`` file (plain, .gz, .zstd), or a folder with ``metadata.yaml``.

    `signals` says which numbers of which topics are the channels. Signals of one topic share a stream, named by the
    topic's last word: ``log.wrench.force``. `kinematics` takes joint states to the tip.
    """

    file: File = Field(description="the bag, a file or a folder, relative to the pipeline file")
    signals: dict[str, MappedSignal] = Field(
        default={},
        description='channels by name: { force = { topic = "/wrench", field = "wrench.force.z", unit = "N" } }',
    )
    kinematics: Kinematics | None = Field(
        default=None, description="the robot whose joints give the streams tip and twist, such as log.tip.z"
    )
    time: Clock = Field(
        default="stamp", description='"stamp" (of the header, else log), "log", or { field = "data", index = 0 }'
    )
    begin: Time | None = Field(
        default=None, ge=0, description="leave out what was logged earlier, counted from the first message"
    )
    end: Time | None = Field(default=None, gt=0, description="leave out what was logged later")
    accept_cut: bool = Field(default=False, description="read the undamaged part of a bag in MCAP files that are cut")

    @model_validator(mode="after")
    def _demand_channels(self) -> Self:
        """Raise ValueError for a device without any channel."""
        if not self.signals and self.kinematics is None:
            raise ValueError("give signals: which numbers of which topics are the channels")
        return self

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The streams, one for each mapped topic."""
        return tuple(feed.stream for feed in self._feeds)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on damage of the files, and on topics without a time."""
        damage = (self._bag.trouble,) if self._bag.trouble else ()
        return (*damage, *untimed_note(self._feeds, self.file.name))

    @property
    def provenance(self) -> Mapping[str, str]:
        """The bag and the SHA-256 of its files, one after another."""
        return file_facts(self.file, self._bag.files)

    @property
    def duration(self) -> float | None:
        """The time [s] from the first message to the last; None without messages."""
        span = self._bag.span
        return (span[1] - span[0]) / 1e9 if span else None

    @contextmanager
    def connect(self, seed: int) -> Iterator[Link]:
        """Open the bag."""
        yield LogLink(self._bag, self._feeds, window(self._bag, self.begin, self.end), str(self.file))

    @cached_property
    def _bag(self) -> Bag:
        """The bag; raises LogError for one that is cut, unless that is accepted."""
        bag = Bag(self.file, self.accept_cut)
        if not bag.complete and not self.accept_cut:
            raise LogError(
                f"{self.file}: the bag is cut: a file has no end; set accept_cut = true to use the undamaged part"
            )
        return bag

    @cached_property
    def _feeds(self) -> list[TopicFeed]:
        """The readers of the mapped topics."""
        return described_feeds(self._bag, self.signals, self.kinematics, self.time, str(self.file))

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Return True for a folder that is one bag, or a file that is named like a bag's database."""
        database_suffixes = tuple(suffix for suffix in SUFFIXES if suffix != ".mcap")
        return path.name.lower().endswith(database_suffixes) or is_bag(path)

    @classmethod
    def survey(cls, path: Path) -> Survey:
        """See `Recording`."""
        return survey_of(_open_bag(path), path, "rosbag2", report_progress)

    @classmethod
    def suggest(cls, path: Path, choices: Mapping[str, str]) -> Suggestion:
        """See `Recording`."""
        return suggestion_for(_open_bag(path), path, "rosbag2-replay", choices)

    @classmethod
    def tables(cls, path: Path, notes: list[str] | None = None) -> Iterator[tuple[str, tuple[str, ...], Batch]]:
        """See `Recording`."""
        return tables_of(_open_bag(path), notes)

    @classmethod
    def texts(cls, path: Path) -> Iterator[tuple[str, tuple[str, ...], Stamps, list[tuple[str, ...]]]]:
        """See `Recording`."""
        return texts_of(_open_bag(path))

    @classmethod
    def recover(cls, path: Path, out: Path, beside: Mapping[str, str] = {}) -> str:
        """See `Recording`."""
        if path.name.endswith(".db3") and path.is_file():
            return recover_bag(path, out, report_progress)
        if path.is_dir():
            raise LogError(f"{path}: recover the files of a bag one by one, and put them into a folder of their own")
        raise LogError(f"{path}: is compressed as a whole: unpack it first, as far as that goes")


def _open_bag(path: Path) -> Container:
    """Return a bag, of one that is cut the undamaged part."""
    return Bag(path, accept_cut=True)
