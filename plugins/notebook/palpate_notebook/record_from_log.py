"""Records from logs: what `palpate info --suggest` finds out, as a record."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterable, Mapping
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
_NAMED = 40  # records
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
        if "record" not in choices and (names := recording_of(log).records(log, choices)):
            there = f"{', '.join(names[:_NAMED])}{', ...' if len(names) > _NAMED else ''}"
            which = f'signals={{"record": {json.dumps(names[0])}}}'
            raise ConfigurationError(f"{log}: holds {len(names)} records ({there}): choose one with {which}")
        facts = facts_beside(log, choices.get("record")) if carried is None else None
        of_file = facts.facts if facts is not None else RigFacts()
        suggestion = suggestion_by_facts(log, of_file, choices, registry.load())
        if missing := [*suggestion.blanks, *map(suggestion.rival_words, suggestion.rivals)]:
            raise ConfigurationError(f"{log}: {'; '.join(missing)}: state it in signals={_asked(suggestion)}")
        if "rate" in choices and suggestion.has_time:
            warnings.warn(f"{log.name}: the rate is ignored: the file has a time", stacklevel=2)
        doubts = suggestion.doubts
        for text in doubts:
            warnings.warn(f"{log.name}: {text}", stacklevel=2)
        if carried is not None:
            tables = with_other_channels(carried, suggestion, choices).tables
        else:
            device = {**suggestion.device, "file": str(log.absolute())}
            tables = {"device": {"log": device}, "alignment": suggestion.alignment, "run": {"assumed": _UNSTATED}}
    channels = dict(tables["alignment"])
    roles = {role: channels.pop(role) for role in list(channels) if _is_signal(role, channels[role])}
    table = channels | alignment_table(roles, timing, delay, sign, tip_mass, tare, alignment)
    stated = _stated(timing, delay, tare, alignment)
    assumed = [
        key
        for pattern in tables.get("run", {}).get("assumed", ())
        for key in ([f"alignment.{role}.delay" for role in roles if role in _TIMED] if "*" in pattern else [pattern])
        if key.startswith("alignment.") and key not in stated
    ]
    name = f"{log.name}:{choices['record']}" if "record" in choices else log.name
    if facts is not None:
        options = {"tip_mass": tip_mass, "tare": tare, "force.delay": delay, "force.uncertainty": timing}
        keys = [*(key for key, value in options.items() if value is not None), *(alignment or {})]
        facts = facts.without(_facts_of_options(facts, keys, table))
    return Record(name, tables["device"], table, log, doubts, assumed=tuple(dict.fromkeys(assumed)), facts=facts)


def _facts_of_options(facts: StatedFacts, keys: Iterable[str], table: Mapping[str, Any]) -> frozenset[str]:
    """Return the keys of the facts that arguments state, by their keys of ``[alignment]``."""
    # A timing excludes any other delay.
    places = ["alignment.force.delay" if key == "force.uncertainty" else f"alignment.{key}" for key in keys]
    return facts_set(facts.facts, [f"{place}=0" for place in places], {"alignment": table}, registry.load())


def _asked(suggestion: Suggestion) -> str:
    """What is to be stated, as Python takes it."""
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
    """Keys of ``[alignment]`` given by the caller; a given timing excludes any other delay."""
    late = delay if isinstance(delay, Mapping) else {} if delay is None else dict.fromkeys(_TIMED)
    roles = _TIMED if timing is not None else [_ROLES.get(role, role) for role in late]
    said = {f"alignment.{role}.delay" for role in roles} | {f"alignment.{key}" for key in alignment or {}}
    return said | ({"alignment.tare"} if tare is not None else set())


def _is_signal(role: str, value: Any) -> bool:
    named = ("force", "position", "velocity", "measuring", "lateral_x", "lateral_y")
    return role in named and isinstance(value, str | dict)
