"""Records from logs: a log by the suggestion of `palpate info --suggest`."""

from __future__ import annotations

import json
import warnings
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from palpate import ConfigurationError
from palpate_engine import RigFacts, facts_set, registry
from palpate_kit.curves.file_facts import facts_beside
from palpate_kit.curves.stated_facts import StatedFacts, suggestion_by_facts
from palpate_kit.logs.draft_pipeline import recording_of
from palpate_kit.runs.replay_source import read_run_log, replay_source, with_other_channels
from palpate_records.recording import Suggestion

from palpate_notebook.argument_names import explains_arguments
from palpate_notebook.record_object import Record, alignment_table

_ROLES = {"height": "position"}
_NAMED = 40  # records that a message names (choice)
_CALLER = 3  # frames from a warning to the caller of `read`
_TIMED = ("force", "position", "velocity")
_UNSTATED = ("alignment.tare", "alignment.*.delay")  # of another's log


@explains_arguments
def read(
    path: str | Path,
    signals: Mapping[str, str | float] | None = None,
    *,
    timing: str | float | None = None,
    delay: str | float | Mapping[str, str | float] | None = None,
    sign: int | Mapping[str, int] | None = None,
    tip_mass: str | float | None = None,
    tare: str | float | None = None,
    alignment: Mapping[str, Any] | None = None,
) -> Record:
    """Return a record from a log: .mcap, .db3, a bag folder, .csv, or a run folder.

    A log that palpate has written states its signals, and what was declared of them; `signals` reads
    some of them elsewhere, and all else stays. Of others, `signals` settles what is what, as in
    ``{"force": "/wrench:wrench.force.z", "height": "z", "rate": "500 Hz"}``; keys of a table's device are taken as
    they are: ``{"columns.force.scale": 25.0, "decimal": ","}``. The rest is found by names, units and what the
    numbers do together; a unit that is only a guess is warned of, and a column that is one is asked for. Delays and
    tare that are not stated are flagged in the results (`assumed`). Of a file that holds several records, such as the
    sheets of a workbook, ``{"record": "gel 1"}`` names one. All else as in `palpate.record`.
    What `rig.toml` and `curves.csv` next to the file state counts wherever nothing here states it, as on the command
    line: the record says which of them states what.

    Raises LogError for what is not a log, ConfigurationError where something must be said that no file can say.
    """
    log = Path(path)
    choices = {_ROLES.get(role, role): str(text) for role, text in (signals or {}).items()}
    carried = read_run_log(log)
    doubts: tuple[str, ...] = ()
    facts: StatedFacts | None = None
    if carried is not None and not choices:
        tables = replay_source(carried).tables
    else:
        if "record" not in choices:
            _demand_one_record(log, choices)
        facts = facts_beside(log, choices.get("record")) if carried is None else None
        suggestion = _suggestion(log, facts, choices)
        doubts = suggestion.doubts
        if carried is not None:
            tables = with_other_channels(carried, suggestion, choices).tables
        else:
            device = {**suggestion.device, "file": str(log.absolute())}
            tables = {"device": {"log": device}, "alignment": suggestion.alignment, "run": {"assumed": _UNSTATED}}

    # The table of [alignment]: what the log has, then what the arguments state.
    channels = dict(tables["alignment"])
    roles = {role: channels.pop(role) for role in list(channels) if _is_signal(role, channels[role])}
    table = channels | alignment_table(roles, timing, delay, sign, tip_mass, tare, alignment)
    patterns = tables.get("run", {}).get("assumed", ())
    assumed = _assumed(patterns, roles, _stated(timing, delay, tare, alignment))
    name = f"{log.name}:{choices['record']}" if "record" in choices else log.name
    if facts is not None:
        options = {"tip_mass": tip_mass, "tare": tare, "force.delay": delay, "force.uncertainty": timing}
        keys = [*(key for key, value in options.items() if value is not None), *(alignment or {})]
        facts = facts.without(_facts_of_options(facts, keys, table))
    return Record(name, tables["device"], table, log, doubts, assumed=assumed, facts=facts)


def _demand_one_record(log: Path, choices: Mapping[str, str]) -> None:
    """Raise ConfigurationError for a file of several records, of which none is chosen."""
    names = recording_of(log).records(log, choices)
    if names:
        listed = f"{', '.join(names[:_NAMED])}{', ...' if len(names) > _NAMED else ''}"
        which = f'signals={{"record": {json.dumps(names[0])}}}'
        raise ConfigurationError(f"{log}: holds {len(names)} records ({listed}): choose one with {which}")


def _suggestion(log: Path, facts: StatedFacts | None, choices: Mapping[str, str]) -> Suggestion:
    """Return how a log is read, and warn of guesses; raises ConfigurationError where something must be stated."""
    of_file = facts.facts if facts is not None else RigFacts()
    suggestion = suggestion_by_facts(log, of_file, choices, registry.load())
    if missing := [*suggestion.blanks, *map(suggestion.rival_words, suggestion.rivals)]:
        raise ConfigurationError(f"{log}: {'; '.join(missing)}: state it in signals={_asked(suggestion)}")
    if "rate" in choices and suggestion.has_time:
        warnings.warn(f"{log.name}: the rate is ignored: the file has a time", stacklevel=_CALLER)
    for text in suggestion.doubts:
        warnings.warn(f"{log.name}: {text}", stacklevel=_CALLER)
    return suggestion


def _assumed(patterns: Iterable[str], roles: Iterable[str], stated: Collection[str]) -> tuple[str, ...]:
    """Return the keys of ``[alignment]`` that nobody states: of `patterns`, in which ``*`` is any signal in time."""
    keys: list[str] = []
    for pattern in patterns:
        if "*" in pattern:
            keys += [f"alignment.{role}.delay" for role in roles if role in _TIMED]
        else:
            keys.append(pattern)
    return tuple(dict.fromkeys(key for key in keys if key.startswith("alignment.") and key not in stated))


def _facts_of_options(facts: StatedFacts, keys: Iterable[str], table: Mapping[str, Any]) -> frozenset[str]:
    """Return the keys of the facts that arguments state, by their keys of ``[alignment]``."""
    # A timing excludes any other delay.
    places = ["alignment.force.delay" if key == "force.uncertainty" else f"alignment.{key}" for key in keys]
    return facts_set(facts.facts, [f"{place}=0" for place in places], {"alignment": table}, registry.load())


def _asked(suggestion: Suggestion) -> str:
    """Return the keys that are to be stated, as Python takes them."""
    names = {role: name for name, role in _ROLES.items()}
    keys = [text.partition(":")[0] for text in suggestion.blanks]
    keys += [names.get(role, role) for role in suggestion.rivals]
    return "{" + ", ".join(f'"{key}": ...' for key in keys) + "}"


def _stated(
    timing: str | float | None,
    delay: str | float | Mapping[str, str | float] | None,
    tare: str | float | None,
    alignment: Mapping[str, Any] | None,
) -> set[str]:
    """Return the keys of ``[alignment]`` that the caller states; a timing excludes any other delay."""
    if timing is not None:
        roles: Iterable[str] = _TIMED
    elif isinstance(delay, Mapping):
        roles = [_ROLES.get(role, role) for role in delay]
    else:
        roles = _TIMED if delay is not None else ()
    keys = {f"alignment.{role}.delay" for role in roles} | {f"alignment.{key}" for key in alignment or {}}
    return keys | ({"alignment.tare"} if tare is not None else set())


def _is_signal(role: str, value: Any) -> bool:
    """Return True for an entry of ``[alignment]`` that names a channel."""
    named = ("force", "position", "velocity", "measuring", "lateral_x", "lateral_y")
    return role in named and isinstance(value, str | dict)
