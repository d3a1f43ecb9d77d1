"""The suggestion for a log of topics: the numbers that are force, position and velocity, their units and clock."""

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
# Choices.
_TAIL_DURATION = 0.5  # [s] of a record behind its last contact, from which on an end of reading is suggested
_CONTACT_LEVEL = 0.5  # of the force's range, up to which it falls behind the last contact
_CONTACT_PERCENTILES = (1.0, 99.8)  # [%] of the forces, which are their range without spikes
_MAX_ROWS = 400_000  # of one topic that are read
_MAX_COLUMNS = 40  # of a topic, beyond which it is not looked into
_MAX_NAMES = 24  # of numbers in a message
_MIN_MESSAGES = 20  # to conclude from
_MAX_LATENESS = 1.0  # [s] by which the stamps of one topic may be later than those of another


@dataclass(frozen=True)
class _StampSpan:
    """The stamps of a topic."""

    first: int  # [ns]
    last: int  # [ns]
    late: float  # [s] by which messages are logged after their stamps, the median


TopicTables = Mapping[str, tuple[tuple[str, ...], Floats, Floats]]  # by topic: columns, time [s], values


def suggestion_for(container: Container, path: Path, device_type: str, choices: Mapping[str, str]) -> Suggestion:
    """Return the tables by which a type of device reads a log.

    `container` is the log, with its topics; `choices` are what a person has stated, by key. Raises LogError for choices
    that apply to tables alone, and if no number can be a force or a position.
    """
    if "lateral" in choices:
        raise LogError(f"{path}: --lateral is for tables; of topics, name lateral_x and lateral_y in [alignment]")
    if "time" in choices:
        raise LogError(f"{path}: --time is for CSV files; its messages have times of their own")
    # The roles of the numbers, and the units that nothing states.
    tables, spans = _topic_tables(container)
    guess = _guess_roles(container, tables, choices, path)
    keys = {role: pick.series.key for role, pick in guess.picks.items()}
    extra: dict[str, list[str]] = {"reasons": [], "doubts": []}
    units = {role: pick.series.unit or roles.UNITS[role] for role, pick in guess.picks.items()}
    _guess_units(guess, units, extra["doubts"], tip_of(choices))
    # The device: its signals, its clock, and the end of reading.
    device: dict[str, Any] = {"type": device_type, "file": str(path), "signals": _signals(keys, units, tables)}
    device |= dict(_times(guess, keys, tables, extra["reasons"]))
    if "time" not in device and (doubt := _doubt_of_stamps(guess, spans)):
        device["time"] = "log"
        extra["doubts"].append(doubt)
    # The alignment: a stream is called after its topic or frame.
    sources = {role: _source(*key) for role, key in keys.items()}
    unique_sources = list(dict.fromkeys(sources.values()))
    names = dict(zip(unique_sources, stream_names(unique_sources), strict=True))
    channels = {role: f"log.{names[source]}.{role}" for role, source in sources.items()}
    factors = {role: si_unit(unit)[1] for role, unit in units.items()}
    return replace(assemble_suggestion(guess, device, channels, factors, extra), has_time=True)


def _guess_roles(container: Container, tables: TopicTables, choices: Mapping[str, str], path: Path) -> RoleGuess:
    """Return which numbers of a log are force, position and velocity.

    `tables` are names of columns, times and values by topic, `choices` the columns that a person has stated, by role.
    Raises LogError if none can be, or if the position is one of several frames and `choices` names none.
    """
    frames = {topic: list(_frames(container, topic)) for topic in tables if _has_frames(container, topic)}
    columns_of_topics = (frames.get(topic) or _columns(container, topic, tables) for topic in tables)
    columns = [column for columns_of_topic in columns_of_topics for column in columns_of_topic]
    chosen = {role: _chosen_column(role, choices[role], columns, tables, path) for role in ROLES if role in choices}
    guess = find_roles([column for column in columns if column.role != "other"], chosen)
    if guess is None:
        raise LogError(f"{path}: {_nothing_found(columns)}")
    rivals = frames.get(guess.picks["position"].series.key[0], ())
    if len(rivals) > 1 and "position" not in chosen:
        raise LogError(f"{path}: {_which_frame(rivals)}")
    return guess


def _signals(keys: Mapping[str, tuple[str, str]], units: Mapping[str, str], tables: TopicTables) -> dict[str, Any]:
    """Return the signals of the device: of each role, and before it those of the other axes that belong to it."""
    signals: dict[str, Any] = {}
    for role, (topic, name) in keys.items():
        for other, field, unit in roles.beside(role, name, tables[topic][0]):
            signals[other] = {"topic": topic, **_field(field), "unit": unit or units[role]}
        signals[role] = {"topic": topic, **_field(name), "unit": units[role]}
    return signals


def _has_frames(container: Container, topic: str) -> bool:
    """Return True for a topic of transforms."""
    return short_name(container.topics[topic].type) == "tf2_msgs/TFMessage"


def _frames(container: Container, topic: str) -> Iterator[NumberColumn]:
    """Yield the height over time of every child frame of a topic of transforms, as columns that could be a position."""
    decoder = decoder_of(container.topics[topic])
    origin = container.span[0] if container.span else 0
    heights: dict[str, list[tuple[Floats, Floats]]] = {}
    count = 0
    for _, messages in container.blocks({topic}):
        for name in sorted({name for row in range(len(messages)) for name in decoder.names(messages.payload(row))}):
            table = decoder.read(messages, [FieldReading(_HEIGHT, None, name)])
            time = (messages.logged[table.rows] - origin) / SECOND
            heights.setdefault(name, []).append((time, table.values[:, 0]))
        if (count := count + len(messages)) > _MAX_ROWS:
            break
    for name, blocks in heights.items():
        time, values = (np.concatenate(columns) for columns in zip(*blocks, strict=True))
        yield NumberColumn(
            label=f"{topic}:{name}",
            time=time,
            values=values,
            role="position",
            why=f"frame {name}",
            unit="m",
            key=(topic, f"{_HEIGHT}@{name}"),
        )


def _which_frame(frames: Sequence[NumberColumn]) -> str:
    """Return the question which of several frames is the tip, with a likely one."""
    names = [printable(frame.label.partition(":")[2]) for frame in frames]
    likely = next((name for name in names if "tool" in name or "tip" in name), names[0])
    return (
        f"position: {frames[0].key[0]} holds the frames {', '.join(names)}; say which is the tip: --position {likely}"
    )


def _nothing_found(columns: Sequence[NumberColumn]) -> str:
    """Return the message on a log without force and position, with the numbers that it has."""
    labels = ", ".join(printable(column.label) for column in columns[:_MAX_NAMES]) or "no numbers"
    more = ", ..." if len(columns) > _MAX_NAMES else ""
    choose = "choose with --force TOPIC:FIELD and --position"
    return f"no two numbers can be force and position; {choose} (there are: {labels}{more})"


def _times(
    guess: RoleGuess, keys: Mapping[str, tuple[str, str]], tables: TopicTables, reasons: list[str]
) -> Iterator[tuple[str, Any]]:
    """Yield the keys of the device for the end of reading, and its clock; append the `reasons`."""
    end = _last_contact(guess.picks["force"].series, guess.signs["force"].value)
    if end is not None:
        reasons.append(f"end: the result is the filter's last estimate, and after {end:.1f} s the load is gone")
        yield "end", f"{end:.1f} s"
    clock = _clock(keys, tables)
    if clock is not None:
        reasons.append(f"time: {clock} (runs with the clock of the recorder)")
        yield "time", {**_field(clock), "unit": "s"}


def _doubt_of_stamps(guess: RoleGuess, spans: Mapping[str, _StampSpan]) -> str | None:
    """Return the doubt that force and motion have one clock, though both were logged together; None without one.

    There is a doubt if the stamps of the two topics have no instant in common, or one is late by more than a second
    against the other. `guess` has the columns of the roles; `spans` are first and last stamp [ns] of each topic, and by
    how much [s] its messages are logged later.
    """
    force_topic = guess.picks["force"].series.key[0]
    force = spans[force_topic]
    clock = 'that of the log is taken (device.log.time=log; "stamp" for those of the headers)'
    for role in ("position", "velocity"):
        if role not in guess.picks:
            continue
        topic = guess.picks[role].series.key[0]
        motion = spans[topic]
        # Stamps of one clock overlap.
        if force.first > motion.last or motion.first > force.last:
            begins = f"they begin {abs(force.first - motion.first) / SECOND:.6g} s apart"
            return f"time: the stamps of {force_topic} and {topic} do not overlap: {begins}; {clock}"
        lateness = force.late - motion.late
        if abs(lateness) > _MAX_LATENESS:
            late_topic = force_topic if lateness > 0 else topic
            behind = f"those of {late_topic} are {abs(lateness):.3g} s behind, by the clock that logged both"
            return f"time: the stamps of {force_topic} and {topic} are of two clocks: {behind}; {clock}"
    return None


def _guess_units(guess: RoleGuess, units: dict[str, str], doubts: list[str], tip: Indenter | None) -> None:
    """Replace the units that no message states by those that the range of each number suggests; append the doubt.

    The unit of the velocity is the one by which it is nearest to the slope of the position; `guess` has the ratio of
    both, as recorded, as its gain. `units` are by role; the `tip` has the radius by which a length or an elasticity is
    plausible.
    """
    picks = guess.picks
    if all(pick.series.unit for role, pick in picks.items() if role != "velocity"):
        return
    spans = {role: span_of(pick.series.values) for role, pick in picks.items()}
    if not picks["position"].series.unit:
        units["position"] = length_unit(spans["position"], tip)
    # A force is plausible by the stiffness that it would mean at that depth.
    length_factor = si_unit(units["position"])[1]
    if not picks["force"].series.unit:
        units["force"], _ = force_unit(spans["force"], spans["position"] * length_factor, tip)
    if "velocity" in units and guess.gain and not picks["velocity"].series.unit:
        gain = abs(guess.gain)
        units["velocity"] = min(
            ("m/s", "mm/s", "um/s"), key=lambda unit: abs(np.log(gain * si_unit(unit)[1] / length_factor))
        )
    guessed = [f"{unit} for the {role}" for role, unit in units.items() if not picks[role].series.unit]
    doubts.append(f"units: {', '.join(guessed)}: nothing states them; they are guesses from the range of each")


def _clock(keys: Mapping[str, tuple[str, str]], tables: TopicTables) -> str | None:
    """Return the name of the number that is the time, if all roles are in one topic; None without one."""
    topics = {topic for topic, _ in keys.values()}
    if len(topics) > 1:
        return None
    names, logged, values = tables[topics.pop()]
    return next((name for k, name in enumerate(names) if roles.runs_with(values[:, k], logged)), None)


def _source(topic: str, name: str) -> str:
    """Return the topic of a number, with its frame if it has one: a stream is named after it."""
    frame = name.partition("@")[2]
    return f"{topic}/{frame}" if frame else topic


def _field(text: str) -> dict[str, Any]:
    """Return the keys of a signal for a number of a message, ``field[index]`` or ``field@frame``."""
    text, _, frame = text.partition("@")
    reading = FieldReading.parse(text)
    if frame:
        return {"field": reading.path, "select": frame}
    return {"field": reading.path, **({} if reading.index is None else {"index": reading.index})}


def _topic_tables(container: Container) -> tuple[TopicTables, dict[str, _StampSpan]]:
    """Return the beginning of every topic that contains numbers, and the span of the stamps of each.

    A table is names of columns, times [s] since the log's begin (n,), and values (n, columns). Without topics that
    palpate computed or commanded, which are not measurements.
    """
    batches: dict[str, list[Batch]] = {}
    names: dict[str, tuple[str, ...]] = {}
    for topic, columns, batch in tables_of(container):
        is_commanded = topic.endswith("/setpoint") and container.topics[topic].type.startswith("palpate_msgs")
        if topic.startswith("/palpate/") or is_commanded or len(columns) > _MAX_COLUMNS:
            continue
        names[topic] = columns
        # The beginning of a topic is enough to find its roles.
        of_topic = batches.setdefault(topic, [])
        if sum(len(earlier.time) for earlier in of_topic) < _MAX_ROWS:
            of_topic.append(batch)
    joined = {topic: join_batches(of_topic) for topic, of_topic in batches.items()}
    origin = container.span[0] if container.span else 0
    tables = {
        topic: (names[topic], (batch.received - origin) / SECOND, batch.values) for topic, batch in joined.items()
    }
    return tables, {topic: _span(batch) for topic, batch in joined.items() if len(batch.time)}


def _span(batch: Batch) -> _StampSpan:
    """Return first and last stamp of the readings of a topic, and their usual lateness."""
    late = float(np.median((batch.received - batch.time) / SECOND))
    return _StampSpan(int(batch.time.min()), int(batch.time.max()), late)


def _columns(container: Container, topic: str, tables: TopicTables) -> list[NumberColumn]:
    """Return every number of a topic with the role that its type or name states; no clock, and none of few messages.

    `tables` are names of columns, times (n,) [s] and values (n, columns) by topic.
    """
    message_type = container.topics[topic].type
    role_by_type = roles.role_of_type(topic, message_type)
    names, time, values = tables[topic]
    columns = []
    for index, name in enumerate(names):
        if role_by_type is None:
            role, why, unit = roles.role_of_name(name)
        elif name == role_by_type[1]:
            role, why, unit = role_by_type[0], f"a {message_type}", roles.UNITS[role_by_type[0]]
        else:
            role, why, unit = "other", "", None
        if len(time) >= _MIN_MESSAGES and not roles.runs_with(values[:, index], time):
            columns.append(
                NumberColumn(
                    label=f"{topic}:{name}",
                    time=time,
                    values=values[:, index],
                    role=role,
                    why=why,
                    unit=unit,
                    key=(topic, name),
                    named=roles.is_unknown_name(name),
                )
            )
    return columns


def _chosen_column(
    role: str, choice: str, columns: list[NumberColumn], tables: TopicTables, path: Path
) -> NumberColumn:
    """Return the column that a choice names: a frame, TOPIC:FIELD, or a topic whose type states its one number.

    `tables` are the numbers by topic, `role` is "force", "position" or "velocity". Raises LogError if the choice names
    none, or several.
    """
    topic, _, name = choice.partition(":")
    frames = [c for c in columns if "@" in c.key[1] and choice in (c.label, c.label.partition(":")[2])]
    if len(frames) == 1:
        return replace(frames[0], role=role, why="chosen")
    if topic not in tables:
        topics = printable(", ".join(tables))
        raise LogError(f"{path}: --{role}: topic {topic!r} holds no numbers (there are: {topics})")
    matches = [c for c in columns if c.key[0] == topic and (c.key[1] == name or (not name and c.role == role))]
    if len(matches) == 1:
        return replace(matches[0], role=role, why="chosen")
    names = printable(", ".join(tables[topic][0][:_MAX_COLUMNS]))
    raise LogError(f"{path}: --{role}: {topic} has no number {name!r} (there are: {names})")


def _last_contact(force: NumberColumn, sign: int) -> float | None:
    """Return when [s] the force was last at half of its range; None if the record ends soon after that."""
    is_good = np.isfinite(force.values) & (np.abs(force.values) < LARGEST)
    time, values = force.time[is_good], sign * force.values[is_good]
    low, high = (float(x) for x in np.percentile(values, _CONTACT_PERCENTILES))
    last = float(time[np.flatnonzero(values >= _CONTACT_LEVEL * (low + high))[-1]])
    return last if time[-1] - last > _TAIL_DURATION else None
