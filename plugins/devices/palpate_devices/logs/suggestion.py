"""A ready mapping for a log nobody has described."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import LogError, Suggestion

from palpate_devices.logs import roles
from palpate_devices.logs.feeds import stream_names
from palpate_devices.logs.readings import SECOND, Reading
from palpate_devices.logs.replay import joined, tables_of
from palpate_devices.logs.roles import Candidate
from palpate_devices.logs.topics import Container

_TARE = 0.9  # [s]
_TAIL = 0.5  # [s]
_ROWS = 400_000  # of one topic that are looked into
_COLUMNS = 40

Floats = NDArray[np.float64]
Looked = Mapping[str, tuple[tuple[str, ...], Floats, Floats]]  # by topic: columns, time [s], values


def suggestion_for(container: Container, path: Path, kind: str, choices: Mapping[str, str]) -> Suggestion:
    """Tables that read a log; raises LogError where a role has no candidate, or several."""
    if "rate" in choices or "time" in choices:
        raise LogError(f"{path}: --time and --rate are for CSV files; its messages have times of their own")
    looked = _looked(container)
    candidates = [candidate for topic in looked for candidate in _candidates(container, topic, looked)]
    chosen = {role: _settled(role, candidates, looked, choices, path) for role in roles.ROLES}
    found = {role: candidate for role, candidate in chosen.items() if candidate is not None}
    clock = next((c for c in candidates if c.role == "time" and all(f.topic == c.topic for f in found.values())), None)
    series = {role: _series(candidate, looked) for role, candidate in found.items()}
    signs = roles.signs({r: t for r, (t, _) in series.items()}, {r: v for r, (_, v) in series.items()})
    names = dict(zip(*_streams(found), strict=True))
    device: dict[str, Any] = {
        "type": kind,
        "file": str(path),
        "signals": {
            role: {"topic": c.topic, **_field(c.field), "unit": roles.UNITS[role]} for role, c in found.items()
        },
    }
    end = _last_contact(*series["force"])
    if end is not None:
        device["end"] = f"{end:.1f} s"
    if clock is not None:
        device["time"] = {**_field(clock.field), "unit": "s"}
    alignment: dict[str, Any] = {
        role: {"channel": f"log.{names[c.topic]}.{role}", "sign": getattr(signs, role)} for role, c in found.items()
    }
    if not roles.at_rest(*series["force"], _TARE):
        alignment["tare"] = "none"
    reasons = [f"{role}: {c} ({c.reason})" for role, c in found.items()]
    reasons += [f"time: {clock} ({clock.reason})"] if clock else []
    if "velocity" not in found:
        reasons.append("velocity: none is recorded; it is the derivative of the position")
    if end is not None:
        reasons.append(f"end: the result is what a filter says at the end, and after {end:.1f} s the load is gone")
    if "tare" in alignment:
        reasons.append(f"tare: the force moves in the first {_TARE} s, which therefore give none")
    return Suggestion(device, alignment, tuple(reasons))


def _streams(found: Mapping[str, Candidate]) -> tuple[list[str], list[str]]:
    topics = list(dict.fromkeys(candidate.topic for candidate in found.values()))
    return topics, stream_names(topics)


def _field(text: str) -> dict[str, Any]:
    reading = Reading.parse(text)
    return {"field": reading.path, **({} if reading.index is None else {"index": reading.index})}


def _looked(container: Container) -> Looked:
    """The beginning of every topic that holds numbers; what palpate itself computed or asked for is no measurement."""
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
    tables = {topic: joined(kept) for topic, kept in blocks.items()}
    origin = container.span[0] if container.span else 0
    return {topic: (names[topic], (t.received - origin) / SECOND, t.values) for topic, t in tables.items()}


def _candidates(container: Container, topic: str, looked: Looked) -> list[Candidate]:
    known = roles.typed(topic, container.topics[topic].type)
    columns, time, values = looked[topic]
    if known:
        return [c for c in known if c.field in columns]
    if len(time) < 20:
        return []
    return roles.untyped(topic, columns, time, values)


def _settled(
    role: str, candidates: list[Candidate], looked: Looked, choices: Mapping[str, str], path: Path
) -> Candidate | None:
    """The one candidate for a role; raises LogError where there are several, or none and one is needed."""
    mine = [candidate for candidate in candidates if candidate.role == role]
    if role in choices:
        return _chosen(role, choices[role], mine, looked, path)
    if len(mine) > 1:
        named = " and ".join(str(candidate) for candidate in mine)
        raise LogError(f"{path}: several numbers could be the {role}: {named}; choose with --{role} TOPIC:FIELD")
    if mine:
        return mine[0]
    if role == "velocity":
        return None
    known = ", ".join(f"{topic}:{name}" for topic, (names, _, _) in looked.items() for name in names[:8])
    raise LogError(
        f"{path}: nothing says by itself that it is the {role}; choose with --{role} TOPIC:FIELD "
        f"(there are: {known or 'no numbers'})"
    )


def _chosen(role: str, choice: str, mine: list[Candidate], looked: Looked, path: Path) -> Candidate:
    topic, _, field = choice.partition(":")
    if topic not in looked:
        raise LogError(f"{path}: --{role}: topic {topic!r} holds no numbers (there are: {', '.join(looked)})")
    if not field:
        fitting = [candidate for candidate in mine if candidate.topic == topic]
        if len(fitting) == 1:
            return fitting[0]
    if field not in looked[topic][0]:
        raise LogError(f"{path}: --{role}: {topic} has no number {field!r} (there are: {', '.join(looked[topic][0])})")
    return Candidate(role, topic, field, "chosen")


def _last_contact(time: Floats, force: Floats) -> float | None:
    """When [s] the force was last at half of its peak, where the record goes on for a while after that."""
    rest = float(np.median(force[: max(len(force) // 20, 1)]))
    away = np.abs(force - rest)
    last = float(time[np.flatnonzero(away >= 0.5 * away.max())[-1]])
    return last if time[-1] - last > _TAIL else None


def _series(candidate: Candidate, looked: Looked) -> tuple[Floats, Floats]:
    columns, time, values = looked[candidate.topic]
    numbers = values[:, columns.index(candidate.field)]
    usable = np.isfinite(numbers)
    return time[usable], numbers[usable]
