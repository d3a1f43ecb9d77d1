"""The README of an exported filter."""

from __future__ import annotations

from collections import Counter

from palpate_kit.kernel import step_function
from palpate_kit.kernel.translation import operations

from palpate_filters.c_export.c_program import part
from palpate_filters.c_export.c_source import CHEAP
from palpate_filters.c_export.exported_track import ExportedTrack


def readme(filter: ExportedTrack, title: str, rate: float, tare_duration: float, pause: float) -> str:
    """Return the text: the filter, its calls, its cost, its check."""
    step = step_function(filter.recursion.step)
    names = operations()
    counts = Counter(names[step.instruction_id(k)] for k in range(step.n_instructions()))
    divisions = counts["OP_DIV"] + counts["OP_INV"]
    cheap = sum(count for name, count in counts.items() if name in CHEAP) - divisions
    inert = sum(counts[name] for name in ("OP_CONST", "OP_INPUT", "OP_OUTPUT"))
    return part("README.md").format(
        title=title,
        parameters=", ".join(f"{p.name} [{p.unit}]" for p in filter.model.parameters),
        rate=rate,
        first=filter.model.parameters[0].name.upper(),
        tare=tare_duration,
        pause=1e3 * pause,
        mass=filter.mass,
        cheap=cheap,
        divisions=divisions,
        functions=step.n_instructions() - cheap - divisions - inert,
        opening=part("opening.md").format(window=filter.window) if filter.window > 0 else "",
    )
