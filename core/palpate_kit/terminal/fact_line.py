"""The tip, material and force that fits assume, in one line: a diameter that was entered as a radius is seen."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Iterator, Sequence

from palpate import ContactModel, Indenter, printable
from palpate_engine import PIPELINE, AlignmentSettings, Pipeline, Registry, Result, is_live, numbers_of

from palpate_kit.terminal.motion_text import Numbers, layer_limit, motion_numbers, motion_text
from palpate_kit.terminal.phrase import Phrase, Quantity, curve_count, merged_phrases, phrase_text, quantity_text

_TARES = {"free-air": "force zeroed in air", "none": "force as recorded", "calibrated": "force zeroed by calibration"}
_DIAMETER = re.compile(r" \(diameter [^)]*\)")
Counted = Sequence[tuple[Pipeline, int]]  # pipelines of curves, each with their number


def fact_line(pipelines: Counted, motions: Sequence[Numbers] = ()) -> str:
    """Return tip, model and force of the first track of the pipelines, and the motions that the records measured.

    As in "sphere, radius 6 mm (diameter 12 mm); dr, nu 0.5, 10 to 22 mm thick; press 1 mm/s, 0 to 2 mm deep; force
    zeroed in air".
    """
    facts = facts_in_words(pipelines, layer_limit(motions))
    return "; ".join(filter(None, [facts.get("tip"), facts["model"], motion_text(motions), facts["force"]]))


def run_subject(pipeline: Pipeline, result: Result) -> str:
    """Return tip and model of a run, the motion of its first track on a point, and the estimator of a single track.

    As in "sphere R 5 mm; 2 Hz, 3.5 to 5.1 mm deep; dr, nu 0.5, half-space if above 330 mm thick; kinematic-ekf".
    """
    if not pipeline.tracks:
        return ""
    tables = [table for track in result.tracks.values() if (table := track.diagnoses.get("motion"))]
    motions = [motion_numbers(table) for table in tables[:1]]
    facts = facts_in_words([(pipeline, 1)], layer_limit(motions))
    tip = _DIAMETER.sub("", facts.get("tip", "")).replace(", radius ", " R ")
    estimators = [pipeline.registry.name_of(type(track.estimator)) for track in pipeline.tracks]
    parts = [tip, motion_text(motions), facts["model"]]
    return "; ".join(filter(None, [*parts, *(estimators if len(estimators) == 1 else [])]))


def command_again(pipeline: Pipeline, result: Result) -> str:
    """Return the command that repeats the estimates of a run from its record, or from the log that it read.

    No arm moves; the command takes the options that state facts.
    """
    from_record = is_live(pipeline.devices) or pipeline.sinks
    command, source = ("replay", result.folder) if from_record else ("run", result.folder / PIPELINE)
    return shlex.join(["palpate", command, str(source)])


def columns_line(pipeline: Pipeline) -> str:
    """Return the names of the force and the height of a log, and the ways in which they count; empty without any.

    As in 'force "Fz (N)", height "z_mm", downwards'.
    """
    alignment = pipeline.alignment
    texts = list[str]()
    for role, signal, reversed_text in (
        ("force", alignment.force, ", negative under compression"),
        ("height", alignment.position, ", downwards"),
    ):
        if (name := _name_in_log(pipeline, signal.channel)) is not None:
            texts.append(f"{role} {name}{reversed_text if signal.sign < 0 else ''}")
    return ", ".join(texts)


def _name_in_log(pipeline: Pipeline, channel: str) -> str | None:
    """Return the column or the field of a channel as its log names it; None for a device that names none."""
    device_name, _, path = channel.partition(".")
    device = pipeline.devices.get(device_name)
    key = path.rpartition(".")[2]
    column = getattr(device, "columns", {}).get(key)
    if column is not None:
        return f"column {column.column}" if isinstance(column.column, int) else f'"{printable(column.column)}"'
    signal = getattr(device, "signals", {}).get(key)
    return None if signal is None else f'"{printable(f"{signal.topic}:{signal.readings[0]}")}"'


def facts_in_words(pipelines: Counted, limit: str = "") -> dict[str, str]:
    """Return words for the tip, where the model has one, the model and the force of the first track of pipelines.

    `limit` is the thickness above which a stated half-space holds, as in "above 330 mm thick".
    """
    phrases_of_pipelines = [(_phrases(pipeline, limit), count) for pipeline, count in pipelines]
    return {
        key: _merged_text([(phrases[key], count) for phrases, count in phrases_of_pipelines if key in phrases])
        for key in ("tip", "model", "force")
        if any(key in phrases for phrases, _ in phrases_of_pipelines)
    }


def _phrases(pipeline: Pipeline, limit: str) -> dict[str, Phrase]:
    """Return the phrases on the tip, the model and the force of the first track of a pipeline."""
    model = pipeline.tracks[0].model
    tip = getattr(model, "indenter", None)
    phrases = {"tip": tip_phrase(tip, pipeline.registry)} if isinstance(tip, Indenter) else {}
    return {
        **phrases,
        "model": _joined(_model_phrases(model, pipeline, limit)),
        "force": _joined(_force_phrases(pipeline.alignment)),
    }


def _merged_text(counted: Iterable[tuple[Phrase, int]]) -> str:
    """Return phrases of many curves as one text; with the number of curves where they differ by more than numbers."""
    groups = merged_phrases(counted)
    texts = [phrase_text(phrases, quantity_text) for phrases, _ in groups]
    if len(groups) == 1:
        return texts[0]
    return " or ".join(f"{text} ({curve_count(count)})" for text, (_, count) in zip(texts, groups, strict=True))


def _joined(phrases: Iterable[Phrase]) -> Phrase:
    """Return phrases as one, separated by commas."""
    return tuple(part for phrase in phrases for part in (", ", *phrase))[1:]


def tip_words(tip: Indenter, registry: Registry) -> str:
    """Return a tip by its kind and numbers, as in "sphere, radius 6 mm (diameter 12 mm)"."""
    return phrase_text([tip_phrase(tip, registry)], quantity_text)


def tip_phrase(tip: Indenter, registry: Registry) -> Phrase:
    """Return a tip by its kind and numbers."""
    phrase: list[str | Quantity] = [registry.name_of(type(tip))]
    for path, value, unit in numbers_of(tip):
        phrase += [f", {' '.join(path).replace('_', ' ')} ", Quantity(value, unit)]
        phrase += [" (diameter ", Quantity(2 * value, unit), ")"] if path == ("radius",) else []
    return tuple(phrase)


def _model_phrases(model: ContactModel, pipeline: Pipeline, limit: str) -> Iterator[Phrase]:
    """Yield the phrases of a model: its name, Poisson's ratio, thickness and base, inclination.

    A phrase is a tuple of texts and quantities; `limit` is the thickness above which a half-space holds, in words.
    """
    name = pipeline.registry.name_of(type(model))
    # A name of several parts is abbreviated: dimensionality-reduction is dr.
    yield ("".join(part[0] for part in name.split("-")) if "-" in name else name,)
    if isinstance(nu := getattr(model, "poisson", None), float):
        yield "nu ", Quantity(nu)
    if "thickness" in type(model).model_fields:
        layer = getattr(model, "thickness", None)
        height = getattr(layer, "height", None)
        half_space = f"half-space if {limit}" if limit else "half-space"
        yield (half_space,) if height is None else (Quantity(height, "m"), " thick")
        if (bonded := getattr(layer, "bonded", None)) is not None:
            yield ("glued to its base" if bonded else "sliding on its base",)
    if inclination := getattr(getattr(model, "skin", None), "inclination", 0.0):
        yield "inclined by ", Quantity(inclination, "rad")


def _force_phrases(alignment: AlignmentSettings) -> Iterator[Phrase]:
    """Yield the phrases of the force: its zero, delay, mass, beam and mount.

    `alignment` has the settings by which force and position were aligned; a phrase is a tuple of texts and quantities.
    """
    tare = alignment.tare
    if isinstance(tare, str):
        yield (_TARES[tare],)
    else:
        std = alignment.zero_uncertainty
        uncertainty = (" ± ", Quantity(std, digits=2)) if std else ()
        is_stated = tare or std
        zero = ("zero of the force ", Quantity(tare), *uncertainty, " N")
        yield zero if is_stated else ("force zeroed before contact",)
    if alignment.timing_uncertainty is not None:
        delay = alignment.force.delay - alignment.position.delay  # [s]
        yield Quantity(1e3 * delay), " ± ", Quantity(1e3 * alignment.timing_uncertainty, digits=2), " ms late"
    if alignment.tip_mass is not None:
        yield Quantity(alignment.tip_mass, "kg"), " behind the sensor"
    if alignment.beam is not None:
        yield "behind a beam of ", Quantity(alignment.beam, "N/m")
    if alignment.series_stiffness is not None:
        yield "on a mount of ", Quantity(alignment.series_stiffness, "N/m")
