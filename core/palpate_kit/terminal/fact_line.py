"""What a fit takes for the tip, the material and the force, in one line: a diameter that was meant is seen at once."""

from __future__ import annotations

import math
from collections.abc import Iterator

from palpate import ContactModel, Indenter, printable
from palpate_engine import AlignmentSettings, Pipeline, Registry, numbers_of

_TARES = {"free-air": "force zeroed in air", "none": "force as recorded", "calibrated": "force zeroed by calibration"}


def fact_line(pipeline: Pipeline) -> str:
    """Tip, model and force of the first track of a pipeline.

    As in "tip: sphere, radius 6 mm (diameter 12 mm); dr, nu 0.5, thick; force zeroed in air".
    """
    words = facts_in_words(pipeline)
    head = [f"tip: {words['tip']}"] if "tip" in words else []
    return "; ".join([*head, words["model"], words["force"]])


def columns_line(pipeline: Pipeline) -> str:
    """Return which numbers of a log are taken for force and height, and which way they count; empty without any.

    As in 'force "Fz (N)", height "z_mm", downwards'.
    """
    alignment, words = pipeline.alignment, list[str]()
    for role, signal, reverse in (
        ("force", alignment.force, ", negative under compression"),
        ("height", alignment.position, ", downwards"),
    ):
        if (name := _name_in_log(pipeline, signal.channel)) is not None:
            words.append(f"{role} {name}{reverse if signal.sign < 0 else ''}")
    return ", ".join(words)


def _name_in_log(pipeline: Pipeline, channel: str) -> str | None:
    """Return the column or the field of a channel as its log names it; None for a device that names none."""
    device_name, _, path = channel.partition(".")
    device, key = pipeline.devices.get(device_name), path.rpartition(".")[2]
    column = getattr(device, "columns", {}).get(key)
    if column is not None:
        return f"column {column.column}" if isinstance(column.column, int) else f'"{printable(column.column)}"'
    signal = getattr(device, "signals", {}).get(key)
    return None if signal is None else f'"{printable(f"{signal.topic}:{signal.readings[0]}")}"'


def facts_in_words(pipeline: Pipeline) -> dict[str, str]:
    """What is taken for the tip, where the model has one, the model and the force of the first track."""
    model = pipeline.tracks[0].model
    tip = getattr(model, "indenter", None)
    found = {"tip": tip_words(tip, pipeline.registry)} if isinstance(tip, Indenter) else {}
    return {**found, "model": ", ".join(_model(model, pipeline)), "force": ", ".join(_force(pipeline.alignment))}


def tip_words(tip: Indenter, known: Registry) -> str:
    """A tip by its kind and numbers, as in "sphere, radius 6 mm (diameter 12 mm)"."""
    words = [known.name_of(type(tip))]
    for path, value, unit in numbers_of(tip):
        across = f" (diameter {quantity_text(2 * value, unit)})" if path == ("radius",) else ""
        words.append(f"{' '.join(path).replace('_', ' ')} {quantity_text(value, unit)}{across}")
    return ", ".join(words)


def _model(model: ContactModel, pipeline: Pipeline) -> Iterator[str]:
    name = pipeline.registry.name_of(type(model))
    yield "".join(word[0] for word in name.split("-")) if "-" in name else name
    if isinstance(nu := getattr(model, "poisson", None), float):
        yield f"nu {nu:g}"
    if "thickness" in type(model).model_fields:
        height = getattr(getattr(model, "thickness", None), "height", None)
        yield "thick" if height is None else f"{quantity_text(height, 'm')} thick"


def _force(alignment: AlignmentSettings) -> Iterator[str]:
    tare = alignment.tare
    if isinstance(tare, str):
        yield _TARES[tare]
    else:
        std = alignment.zero_uncertainty
        stated = f"zero of the force {tare:g}{f' ± {std:.2g}' if std else ''} N"
        yield stated if tare or std else "force zeroed before contact"
    if alignment.timing_uncertainty is not None:
        late, std = 1e3 * (alignment.force.delay - alignment.position.delay), 1e3 * alignment.timing_uncertainty
        yield f"{late:g} ± {std:.2g} ms late"
    if alignment.tip_mass is not None:
        yield f"{1e3 * alignment.tip_mass:g} g behind the sensor"


def quantity_text(value: float, unit: str) -> str:
    """A length in mm or um, an angle in degrees, any other number in its SI unit."""
    if unit == "rad":
        return f"{math.degrees(value):.4g} deg"
    if unit != "m":
        return f"{value:.4g}" + ("" if unit == "1" else f" {unit}")
    word, factor = ("mm", 1e3) if abs(value) >= 1e-4 or not value else ("um", 1e6)
    return f"{value * factor:.4g} {word}"
