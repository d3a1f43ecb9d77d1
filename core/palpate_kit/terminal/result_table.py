"""The table of results: each value with its uncertainty and verdict, the open facts and the findings of each row.

Terminal, report, desk, methods and Python show this table, so that a number and its verdict are the same on all.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from palpate import Condition, Flag
from palpate_engine import Result, TrackComparison, TrackResult, UncertainValue, display_unit, verdict_word

from palpate_kit.terminal.quantities import value_or_fixed

SYMBOLS = {"elasticity": "E", "viscosity": "eta"}
CHIEF = tuple(SYMBOLS)  # values that a screen shows of a model that has them
NOT_READ = "not read"
NOTE = "note"  # in place of a verdict: of a finding that moves no value beyond its uncertainty
NEEDS = "needs "  # before the fact, of a verdict
OPEN = "undetermined"  # the code of the note on a value that the record does not determine
_NAME = re.compile(rf"\b({'|'.join(SYMBOLS)})\b")
_WHOLE_RECORD = "record"  # in place of values, in a cell: of a finding on the whole record
_NOT_DETERMINED = "not determined"
_WORST_FIRST = ["invalid", "doubtful", _NOT_DETERMINED]
# A finding as a text in a cell: code, likely causes, values with the relative sizes of the effects, remedy, sentence.
_FINDING = re.compile(
    r"(?P<code>[a-z0-9-]+)\[(?P<suspects>[^\]]*)\] (?P<sizes>[^:]*): (?P<words>.*?) -> (?P<remedy>.*)"
)
_FINDING_SEPARATOR, _REMEDY_SEPARATOR = " | ", " -> "  # in a cell


@dataclass(frozen=True)
class TableValue:
    """A value with its combined standard uncertainty [SI] and its verdict."""

    name: str
    value: float | None  # None without a number
    combined: float  # NaN if it is not known
    unit: str
    verdict: str
    places: Mapping[str, float] = field(default_factory=dict)  # along a path: low, high, and the spread within combined

    @property
    def symbol(self) -> str:
        """E or eta; the name of any other value."""
        return SYMBOLS.get(self.name, self.name.replace("_", " "))

    @property
    def word(self) -> str:
        """The verdict for a reader."""
        return verdict_word(self.verdict)

    @property
    def shown_unit(self) -> str:
        """The unit in which it is shown; empty for a plain number."""
        unit = display_unit(self.unit)[0]
        return "" if unit == "1" else unit

    @property
    def of_one_place(self) -> float:
        """The combined uncertainty [SI] without the spread over the places of a path, which is not an error."""
        variance = self.combined**2 - self.places.get("spread", 0.0) ** 2
        return math.nan if math.isnan(variance) else math.sqrt(max(variance, 0.0))

    @property
    def number(self) -> str:
        """The value and its uncertainty in the unit that is shown; along a path range and mean; a dash without one."""
        return " ".join(self.number_lines)

    @property
    def number_lines(self) -> tuple[str, ...]:
        """The number in one line; along a path in two: the range, and the mean with its uncertainty."""
        factor = display_unit(self.unit)[1]
        if self.value is None or not math.isfinite(self.value) or self.verdict == "invalid":
            return ("-",)
        number = value_or_fixed(self.value * factor, self.of_one_place * factor)
        if not self.places:
            return (number,)
        low, high = (f"{self.places[end] * factor:.4g}" for end in ("low", "high"))
        return f"{low} to {high},", f"mean {number}"

    @property
    def text(self) -> str:
        """Number, unit and verdict."""
        return " ".join(filter(None, (self.number, self.shown_unit, self.word)))

    @classmethod
    def of(cls, name: str, value: UncertainValue) -> TableValue:
        """Return a value of a track as one of a table."""
        return cls(
            name,
            value=value.value,
            combined=value.combined,
            unit=value.unit,
            verdict=value.verdict or "",
            places=value.places,
        )


@dataclass(frozen=True)
class ResultFinding:
    """A finding against a law or a stated fact, the reason of a value that is not determined, or a note."""

    code: str
    word: str  # the verdict that it makes: doubtful, invalid, not determined or, of no value, note
    suspects: tuple[str, ...]  # likely causes, the likeliest first
    sizes: Mapping[str, float | None]  # by value: the effect relative to it; None if that is not known
    sentence: str
    remedy: str  # an option that states a fact, or an instruction

    @property
    def head(self) -> str:
        """Verdict, code and likeliest cause, as in ``doubtful[lack-of-fit: thickness]``."""
        return f"{self.word}[{': '.join((self.code, *self.suspects[:1]))}]"

    @classmethod
    def of_flag(cls, flag: Flag, values: Mapping[str, float | None]) -> ResultFinding:
        """Return the finding of a flag on a track with `values` [SI].

        Its sizes are the effects on the values it moves, relative to these; None where the size is not known.
        """
        effects = flag.effects or {}
        names = flag.moves or tuple(effects)  # results of older versions lack the first
        sizes: dict[str, float | None] = {}
        for name in names:
            value, effect = values.get(name), effects.get(name)
            sizes[name] = None
            if value and effect is not None and math.isfinite(effect):
                sizes[name] = abs(effect / value)
        word = _NOT_DETERMINED if flag.code == OPEN else flag.severity or "doubtful"
        return cls(
            flag.code,
            word=word,
            suspects=flag.suspects,
            sizes=sizes,
            sentence=flag.sentence,
            remedy=flag.remedy,
        )

    @property
    def cell(self) -> str:
        """The finding as a text in a cell, without the separators in its sentence."""
        sizes = ", ".join(f"{name}" if size is None else f"{name} {size:.3g}" for name, size in self.sizes.items())
        sentence = " ".join(self.sentence.replace(_FINDING_SEPARATOR, " / ").replace(_REMEDY_SEPARATOR, " - ").split())
        head = f"{self.code}[{', '.join(self.suspects)}]"
        return f"{head} {sizes or _WHOLE_RECORD}: {sentence}{_REMEDY_SEPARATOR}{self.remedy}"

    @classmethod
    def of_cell(cls, cell: str, severities: Mapping[str, str]) -> Iterator[ResultFinding]:
        """Yield the findings of a cell of ``fits.csv``, which has them in words; `severities` are those of codes.

        A finding has the causes that it suspects, and the share of each value that it may move, by the value's name.
        """
        for text in filter(None, cell.split(_FINDING_SEPARATOR)):
            if (match := _FINDING.fullmatch(text)) is None:
                continue
            parts = [part.partition(" ") for part in match["sizes"].split(", ") if part != _WHOLE_RECORD]
            sizes = {name: float(size) if size else None for name, _, size in parts}
            suspects = tuple(filter(None, match["suspects"].split(", ")))
            word = _NOT_DETERMINED if match["code"] == OPEN else severities.get(match["code"], "doubtful")
            yield cls(
                match["code"],
                word=word,
                suspects=suspects,
                sizes=sizes,
                sentence=match["words"],
                remedy=match["remedy"],
            )


@dataclass(frozen=True)
class TrackMeasures:
    """The measures of a track that is compared with others."""

    comparison: TrackComparison
    nis: float  # NaN for an estimator without one
    seconds_per_sample: float
    samples: int  # on which the cost was measured
    is_behind: bool = False  # slower than real time

    @classmethod
    def of(
        cls, comparison: TrackComparison | None, nis: float, cost: float, samples: int, duration: float
    ) -> TrackMeasures | None:
        """Return the measures of a track of `samples` in a record of a duration [s]; None for one that is not compared.

        `cost` is the computing time of a sample [s].
        """
        if comparison is None:
            return None
        is_behind = cost * samples > duration > 0
        return cls(comparison, nis, cost, samples, is_behind)


@dataclass(frozen=True)
class ResultRow:
    """A track of a run, or of a file: its values, the open facts, and the findings."""

    record: str  # the file or log; empty of a run
    track: str
    values: Mapping[str, TableValue] = field(default_factory=dict)  # of the model, then those that follow from them
    conditions: Mapping[str, str] = field(default_factory=dict)  # by open fact: the sentence on its assumption
    remedies: Mapping[str, str] = field(default_factory=dict)  # by open fact
    findings: tuple[ResultFinding, ...] = ()
    error: str = ""  # reason for which the file was not read or fitted
    measures: TrackMeasures | None = None  # of a run with several tracks

    @property
    def judging_findings(self) -> list[ResultFinding]:
        """The findings to which values owe their verdicts, each with those values alone."""
        judging = []
        for finding in self.findings:
            # A doubt without a bound leaves no number.
            void_sizes = {name: size for name, size in finding.sizes.items() if size is None and self._is_void(name)}
            if finding.word == "doubtful" and void_sizes:
                judging.append(replace(finding, word="invalid", sizes=void_sizes))
            names = {name for name, value in self.values.items() if value.word == finding.word}
            sizes = {name: size for name, size in finding.sizes.items() if name in names}
            if sizes or (not finding.sizes and names):
                judging.append(replace(finding, sizes=sizes))
        return judging

    @property
    def notes(self) -> list[ResultFinding]:
        """Notes, which make no verdict."""
        return [finding for finding in self.findings if finding.word == NOTE]

    def _is_void(self, name: str) -> bool:
        """Return True for a value that has no number."""
        return name in self.values and self.values[name].word == "invalid"

    @property
    def chief(self) -> dict[str, TableValue]:
        """Elasticity and viscosity; of a model without them its first two values."""
        return {name: self.values[name] for name in chief_names(self.values)}


def chief_names(names: Iterable[str]) -> list[str]:
    """Return the names of the values that a screen shows: elasticity and viscosity, else the first two."""
    all_names = list(names)
    return [name for name in CHIEF if name in all_names] or all_names[:2]


@dataclass(frozen=True)
class ResultTable:
    """The rows of a run, of logs or of a folder."""

    rows: tuple[ResultRow, ...]
    truth: Mapping[str, float] = field(default_factory=dict)  # [SI] of a simulated rig, by value
    of_record: tuple[Flag, ...] = ()  # notes on the record
    thing: str = "track"  # that a row is of: a track, a file, a run

    @property
    def names(self) -> list[str]:
        """Names of the chief values of all rows."""
        return list(dict.fromkeys(name for row in self.rows for name in row.chief))

    @property
    def read(self) -> list[ResultRow]:
        """The rows without an error."""
        return [row for row in self.rows if not row.error]

    def partition(self) -> str:
        """Return the numbers of rows by their verdicts for each value; the numbers of a value add up to the rows.

        As in "24 files. E: 0 good, 20 doubtful, 3 not determined; eta: 23 need a delay; 1 not read".
        """
        unread = len(self.rows) - len(self.read)
        parts = [f"{SYMBOLS.get(name, name)}: {count_words(self._verdict_counts(name))}" for name in self.names]
        parts += [f"{unread} not read"] if unread else []
        return f"{counted(len(self.rows), self.thing)}. {'; '.join(parts)}"

    def _verdict_counts(self, name: str) -> Counter[str]:
        values = (row.values.get(name) for row in self.read)
        return Counter("without" if value is None else value.word or "not judged" for value in values)

    def shared_findings(self) -> list[tuple[ResultFinding, list[ResultRow], list[str]]]:
        """Return each finding once with its rows and the names of its values, the worst and most frequent first.

        Findings of one code and one cause are one, with the largest of their sizes.
        """
        shared = self._shared([(finding, row) for row in self.rows for finding in row.judging_findings])
        return sorted(shared, key=lambda group: (_WORST_FIRST.index(group[0].word), -len(group[1])))

    def shared_notes(self) -> list[tuple[ResultFinding, list[ResultRow], list[str]]]:
        """Return each note once with the rows that have it, that of most rows first."""
        shared = self._shared([(note, row) for row in self.rows for note in row.notes])
        return sorted(shared, key=lambda group: -len(group[1]))

    def _shared(
        self, pairs: Sequence[tuple[ResultFinding, ResultRow]]
    ) -> list[tuple[ResultFinding, list[ResultRow], list[str]]]:
        """Return findings merged by verdict, code and likeliest cause, with their rows and the names of their values.

        The sizes of a merged finding are the largest of its members; its sentence is that of the first one.
        """
        groups: dict[tuple[str, str, str], list[tuple[ResultFinding, ResultRow]]] = {}
        for finding, row in pairs:
            cause = finding.suspects[0] if finding.suspects else ""
            groups.setdefault((finding.word, finding.code, cause), []).append((finding, row))
        shared = []
        for members in groups.values():
            sizes = _largest([finding for finding, _ in members])
            names = [name for name in dict.fromkeys((*self.names, *sizes)) if name in sizes]
            first_finding = members[0][0]
            suspects = tuple(dict.fromkeys(cause for finding, _ in members for cause in finding.suspects))
            merged = replace(first_finding, suspects=suspects, sizes=sizes)
            rows = list({id(row): row for _, row in members}.values())  # one row may have several of a cause
            shared.append((merged, rows, names))
        return shared

    def open_facts(self) -> list[tuple[str, str, str, int]]:
        """Return each open fact with the sentence on its assumption, its remedy, and the number of rows.

        Facts that a value needs come first, then those of most rows.
        """
        counts = Counter(fact for row in self.read for fact in row.conditions)
        needs = Counter(value.verdict.removeprefix(NEEDS) for row in self.read for value in row.values.values())
        first_rows = {fact: row for row in reversed(self.read) for fact in row.conditions}
        return [
            (fact, first_rows[fact].conditions[fact], first_rows[fact].remedies.get(fact, ""), count)
            for fact, count in sorted(counts.items(), key=lambda item: (-needs[item[0]], -item[1]))
        ]


def _largest(findings: Sequence[ResultFinding]) -> dict[str, float | None]:
    """Return the largest size of each value; None if one of them is not known."""
    sizes: dict[str, float | None] = {}
    for finding in findings:
        for name, size in finding.sizes.items():
            largest = sizes.get(name, 0.0)
            sizes[name] = None if size is None or largest is None else max(size, largest)
    return sizes


def count_words(words: Counter[str]) -> str:
    """Return counts of verdicts as in "2 good, 1 doubtful, 3 need a delay"; good and doubtful if one of them occurs."""
    texts = []
    if {"good", "doubtful"} & words.keys():
        texts = [f"{words['good']} good", f"{words['doubtful']} doubtful"]
    for verdict in sorted(words.keys() - {"good", "doubtful"}):
        count = words[verdict]
        if verdict.startswith(NEEDS):
            need = "needs" if count == 1 else "need"
            texts.append(f"{count} {need} {_article(verdict.removeprefix(NEEDS))}")
        else:
            texts.append(f"{count} {verdict}")
    return ", ".join(texts)


def _article(fact: str) -> str:
    """Return a fact with its article."""
    return f"{'an' if fact[:1] in 'aeiou' else 'a'} {fact}"


def counted(number: int, thing: str) -> str:
    """Return "1 file", "2 files"."""
    return f"{number} {thing}{'' if number == 1 else 's'}"


def with_symbols(text: str) -> str:
    """Return a sentence with the symbols of the values in place of their names.

    >>> with_symbols("Poisson's ratio 0.5: 0.45 makes elasticity 6 %, viscosity 9.1 % higher")
    "Poisson's ratio 0.5: 0.45 makes E 6 %, eta 9.1 % higher"
    """
    return _NAME.sub(lambda match: SYMBOLS[match[1]], text)


def track_row(
    track: TrackResult, label: str, record: str = "", of_record: Sequence[Flag] = (), duration: float = 0.0
) -> ResultRow:
    """Return the row of a track called `label` in the table of results.

    Flags are its own and those of its record; `duration` [s] is that of the record.
    """
    estimates = {**track.parameters, **{value.name: value.found for value in track.derived}}
    values = {name: TableValue.of(name, estimate) for name, estimate in estimates.items()}
    if not track.usable:
        values = {name: TableValue(name, None, math.nan, value.unit, "invalid") for name, value in estimates.items()}
    numbers = {name: estimate.value for name, estimate in estimates.items()}
    # Of several conditions on one fact the first counts: a dictionary keeps the last, hence the reverse order.
    conditions: dict[str, Condition] = {condition.fact: condition for condition in reversed(track.conditions)}
    return ResultRow(
        record,
        track=label,
        values=values,
        conditions={fact: condition.sentence(estimates) for fact, condition in reversed(conditions.items())},
        remedies={fact: condition.remedy for fact, condition in conditions.items()},
        findings=tuple(ResultFinding.of_flag(flag, numbers) for flag in (*of_record, *track.flags)),
        measures=TrackMeasures.of(track.comparison, track.nis, track.seconds_per_sample, track.samples, duration),
    )


def result_table(result: Result, record: str = "") -> ResultTable:
    """Return the table of the tracks of a run."""
    judging_flags = [flag for flag in result.flags if flag.severity != NOTE]
    duration = result.run.get("log_duration") or 0.0
    rows = tuple(track_row(track, label, record, judging_flags, duration) for label, track in result.tracks.items())
    return ResultTable(rows, result.truth, tuple(flag for flag in result.flags if flag.severity == NOTE))
