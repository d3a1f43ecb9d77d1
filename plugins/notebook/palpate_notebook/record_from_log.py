"""Records from logs, read by the suggestion of `palpate info --suggest`."""

from __future__ import annotations

import json
import warnings
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
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

_ROLES = {"height": "position"}  # roles of signals in [alignment], where `read` has other names
_MAX_LISTED = 40  # records that a message names: a choice
_CALLER_LEVEL = 5  # frames from a warning to the caller of `read`
_TIMED = ("force", "position", "velocity")  # signals that have a delay
_UNSTATED = ("alignment.tare", "alignment.*.delay")  # in a log that palpate has not written


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

    A log that palpate has written states its signals and their declarations; `signals` reads some of them from other
    channels. For other logs, `signals` assigns channels, as in
    ``{"force": "/wrench:wrench.force.z", "height": "z", "rate": "500 Hz"}``, and sets keys of the device of a table:
    ``{"columns.force.scale": 25.0, "decimal": ","}``. ``{"record": "gel 1"}`` names one of several records of a file,
    such as the sheets of a workbook. What `signals` does not assign is found by names, units and numbers: there is a
    warning for a unit, and an error for a column, that is only a guess. Delays and tare that nothing states are
    flagged in the results (`assumed`).

    The other arguments are those of `palpate.record`. Facts in `rig.toml` and `curves.csv` next to the file count
    where no argument states them, as on the command line; the record lists them.

    Raises LogError for a file that is not a log, ConfigurationError for a statement that is missing.
    """
    log = Path(path)
    choices = {_ROLES.get(signal, signal): str(choice) for signal, choice in (signals or {}).items()}
    tables = _log_tables(log, choices)

    # The table of [alignment]: entries of the log, then those that the arguments state.
    entries = dict(tables.alignment)
    channels = {role: entries.pop(role) for role in list(entries) if _is_signal(role, entries[role])}
    table = entries | alignment_table(channels, timing, delay, sign, tip_mass, tare, alignment)
    assumed = _assumed_keys(tables.assumed, channels, _stated_keys(timing, delay, tare, alignment))
    # Facts of files count where no argument states them.
    facts = tables.facts
    if facts is not None:
        options = {"tip_mass": tip_mass, "tare": tare, "force.delay": delay, "force.uncertainty": timing}
        stated = [*(key for key, option in options.items() if option is not None), *(alignment or {})]
        facts = facts.without(_facts_of_options(facts, stated, table))
    name = f"{log.name}:{choices['record']}" if "record" in choices else log.name
    return Record(name, tables.devices, table, log, tables.doubts, assumed=assumed, facts=facts)


@dataclass(frozen=True)
class _LogTables:
    """Tables of a pipeline that reads a log, with the facts next to it."""

    devices: Mapping[str, Any]
    alignment: Mapping[str, Any]
    assumed: Iterable[str]  # patterns of keys that nothing states; ``*`` is any signal
    doubts: tuple[str, ...] = ()  # sentences on guesses
    facts: StatedFacts | None = None


def _log_tables(log: Path, choices: Mapping[str, str]) -> _LogTables:
    """Return the tables that read a log: its own if palpate has written it, else suggested ones; `choices` by role."""
    run_log = read_run_log(log)
    if "record" not in choices and (run_log is None or choices):
        _demand_one_record(log, choices)
    if run_log is None:
        facts = facts_beside(log, choices.get("record"))
        suggestion = _suggestion(log, facts, choices)
        device = {**suggestion.device, "file": str(log.absolute())}
        return _LogTables({"log": device}, suggestion.alignment, _UNSTATED, suggestion.doubts, facts)
    if choices:
        suggestion = _suggestion(log, None, choices)
        tables = with_other_channels(run_log, suggestion, choices).tables
        doubts = suggestion.doubts
    else:
        tables = replay_source(run_log).tables
        doubts = ()
    assumed = tables.get("run", {}).get("assumed", ())
    return _LogTables(tables["device"], tables["alignment"], assumed, doubts)


def _demand_one_record(log: Path, choices: Mapping[str, str]) -> None:
    """Raise ConfigurationError for a file of several records, of which none is chosen."""
    names = recording_of(log).records(log, choices)
    if names:
        listed = f"{', '.join(names[:_MAX_LISTED])}{', ...' if len(names) > _MAX_LISTED else ''}"
        example = f'signals={{"record": {json.dumps(names[0])}}}'
        raise ConfigurationError(f"{log}: holds {len(names)} records ({listed}): choose one with {example}")


def _suggestion(log: Path, facts: StatedFacts | None, choices: Mapping[str, str]) -> Suggestion:
    """Return the suggested tables of a log, and warn of guesses; raises ConfigurationError for facts that it lacks."""
    rig_facts = facts.facts if facts is not None else RigFacts()
    suggestion = suggestion_by_facts(log, rig_facts, choices, registry.load())
    if missing := [*suggestion.blanks, *map(suggestion.rival_words, suggestion.rivals)]:
        raise ConfigurationError(f"{log}: {'; '.join(missing)}: state it in signals={_signals_to_state(suggestion)}")
    if "rate" in choices and suggestion.has_time:
        warnings.warn(f"{log.name}: the rate is ignored: the file has a time", stacklevel=_CALLER_LEVEL)
    for doubt in suggestion.doubts:
        warnings.warn(f"{log.name}: {doubt}", stacklevel=_CALLER_LEVEL)
    return suggestion


def _assumed_keys(patterns: Iterable[str], roles: Iterable[str], stated: Collection[str]) -> tuple[str, ...]:
    """Return the keys of ``[alignment]`` in `patterns` that are not `stated`; ``*`` is any role with a delay."""
    keys: list[str] = []
    for pattern in patterns:
        if "*" in pattern:
            keys += [f"alignment.{role}.delay" for role in roles if role in _TIMED]
        else:
            keys.append(pattern)
    return tuple(dict.fromkeys(key for key in keys if key.startswith("alignment.") and key not in stated))


def _facts_of_options(facts: StatedFacts, keys: Iterable[str], table: Mapping[str, Any]) -> frozenset[str]:
    """Return the keys of the facts that arguments state, by their keys of ``[alignment]``."""
    assignments = []
    for key in keys:
        # A timing excludes any other delay.
        key_of_fact = "force.delay" if key == "force.uncertainty" else key
        assignments.append(f"alignment.{key_of_fact}=0")
    return facts_set(facts.facts, assignments, {"alignment": table}, registry.load())


def _signals_to_state(suggestion: Suggestion) -> str:
    """Return the argument `signals` with the keys that a suggestion leaves open."""
    names = {role: name for name, role in _ROLES.items()}
    keys = [blank.partition(":")[0] for blank in suggestion.blanks]
    keys += [names.get(role, role) for role in suggestion.rivals]
    return "{" + ", ".join(f'"{key}": ...' for key in keys) + "}"


def _stated_keys(
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


def _is_signal(role: str, entry: Any) -> bool:
    """Return True for an entry of ``[alignment]`` that names a channel."""
    roles = ("force", "position", "velocity", "measuring", "lateral_x", "lateral_y")
    return role in roles and isinstance(entry, str | dict)
