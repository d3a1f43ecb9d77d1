"""A ready mapping for a log without a description."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Batch, Floats, Indenter, LogError, printable
from palpate_records.log_tables import tables_of
from palpate_records.messages.decoders import decoder_of
from palpate_records.messages.definitions import short_name
from palpate_records.messages.feeds import stream_names
from palpate_records.messages.readings import LARGEST, SECOND, FieldReading, si_unit
from palpate_records.messages.topics import Container
from palpate_records.recording import Suggestion

from palpate_kit.logs import stated_roles as roles
from palpate_kit.logs.log_link import join_batches
from palpate_kit.logs.role_evidence import span_of
from palpate_kit.logs.role_guess import ROLES, NumberColumn, RoleGuess
from palpate_kit.logs.suggestion import assemble_suggestion, find_roles, force_unit, length_unit, tip_of

_HEIGHT = "transforms.transform.translation.z"  # of a child frame
_TAIL = 0.5  # [s]
_ROWS = 400_000  # of one topic that are looked into
_COLUMNS = 40
_NAMED = 24  # numbers that a message names
_LEAST = 20  # fewest messages to conclude from

_APART = 1.0  # [s] by which the stamps of one topic are later than those of another, at most


@dataclass(frozen=True)
class _StampSpan:
    """The stamps of a topic."""

    first: int  # [ns]
    last: int
    late: float  # [s] by which messages are logged after their stamps, usually


Looked = Mapping[str, tuple[tuple[str, ...], Floats, Floats]]  # by topic: columns, time [s], values


def suggestion_for(container: Container, path: Path, kind: str, choices: Mapping[str, str]) -> Suggestion:
    """Tables that read a log; raises LogError where nothing in it can be a force or a position."""
    if "lateral" in choices:
        raise LogError(f"{path}: --lateral is for tables; of topics, name lateral_x and lateral_y in [alignment]")
    if "time" in choices:
        raise LogError(f"{path}: --time is for CSV files; its messages have times of their own")
    looked, spans = _looked(container)
    frames = {topic: list(_frames(container, topic)) for topic in looked if _is_of_frames(container, topic)}
    every = {topic: frames.get(topic) or _all_of(container, topic, looked) for topic in looked}
    series = [s for found in every.values() for s in found]
    chosen = {role: _chosen(role, choices[role], series, looked, path) for role in ROLES if role in choices}
    found = find_roles([s for s in series if s.role != "other"], chosen)
    if found is None:
        raise LogError(f"{path}: {_nothing_found(series)}")
    rivals = frames.get(found.picks["position"].series.key[0], ())
    if len(rivals) > 1 and "position" not in chosen:
        raise LogError(f"{path}: {_which_frame(rivals)}")
    keys = {role: pick.series.key for role, pick in found.picks.items()}
    sources = {role: _source(*key) for role, key in keys.items()}
    names = dict(zip(*_streams(list(sources.values())), strict=True))
    units = {role: pick.series.unit or roles.UNITS[role] for role, pick in found.picks.items()}
    extra: dict[str, list[str]] = {"reasons": [], "doubts": []}
    _guess_units(found, units, extra["doubts"], tip_of(choices))
    signals: dict[str, Any] = {}
    for role, (topic, name) in keys.items():
        for other, field, unit in roles.beside(role, name, looked[topic][0]):
            signals[other] = {"topic": topic, **_field(field), "unit": unit or units[role]}
        signals[role] = {"topic": topic, **_field(name), "unit": units[role]}  # last: the third axis of a force
    device: dict[str, Any] = {"type": kind, "file": str(path), "signals": signals}
    device |= dict(_times(found, keys, looked, extra["reasons"]))
    if "time" not in device and (apart := _stamps_apart(found, spans)):
        device["time"] = "log"
        extra["doubts"].append(apart)
    channels = {role: f"log.{names[source]}.{role}" for role, source in sources.items()}
    factors = {role: si_unit(unit)[1] for role, unit in units.items()}
    return replace(assemble_suggestion(found, device, channels, factors, extra), has_time=True)


def _is_of_frames(container: Container, topic: str) -> bool:
    return short_name(container.topics[topic].type) == "tf2_msgs/TFMessage"


def _frames(container: Container, topic: str) -> Iterator[NumberColumn]:
    """Yield the height of every child frame of a topic of transforms."""
    decoder, origin = decoder_of(container.topics[topic]), container.span[0] if container.span else 0
    heights: dict[str, list[tuple[Floats, Floats]]] = {}
    count = 0
    for _, messages in container.blocks({topic}):
        for name in sorted({name for row in range(len(messages)) for name in decoder.names(messages.payload(row))}):
            table = decoder.read(messages, [FieldReading(_HEIGHT, None, name)])
            time = (messages.logged[table.rows] - origin) / SECOND
            heights.setdefault(name, []).append((time, table.values[:, 0]))
        if (count := count + len(messages)) > _ROWS:
            break
    for name, blocks in heights.items():
        time, values = (np.concatenate(columns) for columns in zip(*blocks, strict=True))
        yield NumberColumn(
            f"{topic}:{name}", time, values, "position", f"frame {name}", "m", (topic, f"{_HEIGHT}@{name}")
        )


def _which_frame(frames: Sequence[NumberColumn]) -> str:
    names = [printable(frame.label.partition(":")[2]) for frame in frames]
    likely = next((name for name in names if "tool" in name or "tip" in name), names[0])
    return (
        f"position: {frames[0].key[0]} holds the frames {', '.join(names)}; say which is the tip: --position {likely}"
    )


def _nothing_found(series: Sequence[NumberColumn]) -> str:
    known = ", ".join(printable(s.label) for s in series[:_NAMED]) or "no numbers"
    more = ", ..." if len(series) > _NAMED else ""
    choose = "choose with --force TOPIC:FIELD and --position"
    return f"no two numbers can be force and position; {choose} (there are: {known}{more})"


def _times(
    found: RoleGuess, keys: Mapping[str, tuple[str, str]], looked: Looked, reasons: list[str]
) -> Iterator[tuple[str, Any]]:
    """Keys of the device for the end of reading, and its clock."""
    end = _last_contact(found.picks["force"].series, found.signs["force"].value)
    if end is not None:
        reasons.append(f"end: the result is the filter's last estimate, and after {end:.1f} s the load is gone")
        yield "end", f"{end:.1f} s"
    clock = _clock(keys, looked)
    if clock is not None:
        reasons.append(f"time: {clock} (runs with the clock of the recorder)")
        yield "time", {**_field(clock), "unit": "s"}


def _stamps_apart(found: RoleGuess, spans: Mapping[str, _StampSpan]) -> str | None:
    """That the clocks of two roles are not one, though both were logged together; None where they may be.

    Their stamps have no instant in common, or one of them is late by more than a second against the other.
    """
    for role in ("position", "velocity"):
        if role not in found.picks:
            continue
        one, other = (found.picks[r].series.key[0] for r in ("force", role))
        mine, theirs = spans[one], spans[other]
        taken = 'that of the log is taken (device.log.time=log; "stamp" for those of the headers)'
        if mine.first > theirs.last or theirs.first > mine.last:
            begins = f"they begin {abs(mine.first - theirs.first) / SECOND:.6g} s apart"
            return f"time: the stamps of {one} and {other} do not overlap: {begins}; {taken}"
        if abs(late := mine.late - theirs.late) > _APART:
            behind = (
                f"those of {one if late > 0 else other} are {abs(late):.3g} s behind, by the clock that logged both"
            )
            return f"time: the stamps of {one} and {other} are of two clocks: {behind}; {taken}"
    return None


def _guess_units(found: RoleGuess, units: dict[str, str], doubts: list[str], tip: Indenter | None) -> None:
    """Units of numbers whose type gives none: SI by the convention of ROS, doubted where unlikely."""
    if all(pick.series.unit for role, pick in found.picks.items() if role != "velocity"):
        return
    spans = {r: span_of(p.series.values) for r, p in found.picks.items()}
    if not found.picks["position"].series.unit:
        units["position"] = length_unit(spans["position"], tip)
    way = spans["position"] * si_unit(units["position"])[1]
    if not found.picks["force"].series.unit:
        units["force"], _ = force_unit(spans["force"], way, tip)
    if "velocity" in units and found.gain and not found.picks["velocity"].series.unit:
        scale = si_unit(units["position"])[1]
        units["velocity"] = min(
            ("m/s", "mm/s", "um/s"), key=lambda u: abs(np.log(abs(found.gain or 1.0) * si_unit(u)[1] / scale))
        )
    guessed = [f"{unit} for the {role}" for role, unit in units.items() if not found.picks[role].series.unit]
    doubts.append(f"units: {', '.join(guessed)}: nothing states them; they are guesses from the range of each")


def _clock(keys: Mapping[str, tuple[str, str]], looked: Looked) -> str | None:
    """Return the number in the messages that is the time, where all roles are in one topic."""
    topics = {topic for topic, _ in keys.values()}
    if len(topics) > 1:
        return None
    names, logged, values = looked[topics.pop()]
    return next((name for k, name in enumerate(names) if roles.runs_with(values[:, k], logged)), None)


def _source(topic: str, name: str) -> str:
    """What a stream is named after: the topic, or a frame of it."""
    frame = name.partition("@")[2]
    return f"{topic}/{frame}" if frame else topic


def _streams(topics: list[str]) -> tuple[list[str], list[str]]:
    unique = list(dict.fromkeys(topics))
    return unique, stream_names(unique)


def _field(text: str) -> dict[str, Any]:
    text, _, frame = text.partition("@")
    reading = FieldReading.parse(text)
    if frame:
        return {"field": reading.path, "select": frame}
    return {"field": reading.path, **({} if reading.index is None else {"index": reading.index})}


def _looked(container: Container) -> tuple[Looked, dict[str, _StampSpan]]:
    """Return the beginning of every topic that contains numbers, and the stamps of each.

    What palpate computed or commanded is not a measurement.
    """
    blocks: dict[str, Any] = {}
    names: dict[str, tuple[str, ...]] = {}
    for topic, columns, batch in tables_of(container):
        commanded = topic.endswith("/setpoint") and container.topics[topic].type.startswith("palpate_msgs")
        if topic.startswith("/palpate/") or commanded or len(columns) > _COLUMNS:
            continue
        names[topic] = columns
        kept = blocks.setdefault(topic, [])
        if sum(len(block.time) for block in kept) < _ROWS:
            kept.append(batch)
    tables = {topic: join_batches(kept) for topic, kept in blocks.items()}
    origin = container.span[0] if container.span else 0
    looked = {topic: (names[topic], (t.received - origin) / SECOND, t.values) for topic, t in tables.items()}
    return looked, {topic: _span(table) for topic, table in tables.items() if len(table.time)}


def _span(table: Batch) -> _StampSpan:
    late = float(np.median((table.received - table.time) / SECOND))
    return _StampSpan(int(table.time.min()), int(table.time.max()), late)


def _all_of(container: Container, topic: str, looked: Looked) -> list[NumberColumn]:
    """Return every number of a topic, with the role that its type or its name states."""
    known = roles.role_of_type(topic, container.topics[topic].type)
    columns, time, values = looked[topic]
    found = []
    for k, name in enumerate(columns):
        role, why, unit = roles.role_of_name(name)
        if known is not None:
            role, why, unit = (
                (known[0], f"a {container.topics[topic].type}", roles.UNITS[known[0]])
                if name == known[1]
                else ("other", "", None)
            )
        if len(time) >= _LEAST and not roles.runs_with(values[:, k], time):
            named, key = roles.is_unknown_name(name), (topic, name)
            found.append(NumberColumn(f"{topic}:{name}", time, values[:, k], role, why, unit, key, named))
    return found


def _chosen(role: str, choice: str, series: list[NumberColumn], looked: Looked, path: Path) -> NumberColumn:
    topic, _, name = choice.partition(":")
    framed = [s for s in series if "@" in s.key[1] and choice in (s.label, s.label.partition(":")[2])]
    if len(framed) == 1:
        return replace(framed[0], role=role, why="chosen")
    if topic not in looked:
        there = printable(", ".join(looked))
        raise LogError(f"{path}: --{role}: topic {topic!r} holds no numbers (there are: {there})")
    mine = [s for s in series if s.key[0] == topic and (s.key[1] == name or (not name and s.role == role))]
    if len(mine) == 1:
        return replace(mine[0], role=role, why="chosen")
    there = printable(", ".join(looked[topic][0][:_COLUMNS]))
    raise LogError(f"{path}: --{role}: {topic} has no number {name!r} (there are: {there})")


def _last_contact(force: NumberColumn, sign: int) -> float | None:
    """When [s] the force was last at half of its peak, where the record continues for a while after that."""
    good = np.isfinite(force.values) & (np.abs(force.values) < LARGEST)
    time, values = force.time[good], sign * force.values[good]
    low, high = (float(x) for x in np.percentile(values, (1.0, 99.8)))
    last = float(time[np.flatnonzero(values >= 0.5 * (low + high))[-1]])
    return last if time[-1] - last > _TAIL else None
