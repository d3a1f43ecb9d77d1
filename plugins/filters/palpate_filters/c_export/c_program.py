"""The C of an exported filter: what follows from its expressions, then the parts that are the same for all."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from importlib.resources import files

from palpate import Layout
from palpate_kit.kernel import step_function

from palpate_filters.c_export.c_source import c_function, c_number
from palpate_filters.c_export.exported_track import ExportedTrack, SettingGroup
from palpate_filters.starting_fit import PAUSE

_RISE_BLOCKS = 160
_AIR = 2000  # samples of free air that the noise is measured in
_BASELINE, _AFTER = 1.0, 0.2  # [s]; of the lag
_LONGEST = 4.0  # start windows
_MARGIN = 1.1
_SHARE = 2e6  # readings that the work of a second may look at
_CHANGE = 4 * 41 + 5  # passes over the readings that a change point is looked for in
_FIT = 6 * 110  # those over a window of the starting fit, each as much work as six


def part(name: str) -> str:
    """A part that is the same for all filters."""
    return (files("palpate_filters") / "c_export" / "c" / name).read_text("utf-8")


def header(filter: ExportedTrack, title: str, rate: float, tare_duration: float, touch_lag: float) -> str:
    """``palpate_filter.h``: sizes, settings, what is called."""
    longest = _longest(tare_duration, touch_lag) + _waiting(filter, rate, tare_duration, touch_lag)
    sizes = {
        "PALPATE_PARAMETERS": len(filter.model.parameters),
        "PALPATE_STATE": filter.carried.size,
        "PALPATE_RATE": c_number(rate) + " /* [Hz] that the memory is made for */",
        "PALPATE_RECORD": f"{math.ceil(_MARGIN * rate * longest) + 16} /* samples before the touch, or waiting */",
        "PALPATE_WINDOW": f"{_window(filter, rate)} /* samples that it starts on */",
        "PALPATE_AIR": _AIR if filter.measures_noise else 0,
        "PALPATE_RISE_BLOCKS": _RISE_BLOCKS,
    }
    names = [f"    PALPATE_{_upper(p.name)} = {i}, /* [{p.unit}] */" for i, p in enumerate(filter.model.parameters)]
    return "\n".join(
        [
            f"/* {title}; made by palpate {version('palpate')}. SI units everywhere. */",
            "#ifndef PALPATE_FILTER_H",
            "#define PALPATE_FILTER_H",
            "",
            "#include <stdint.h>",
            "",
            "#ifdef __cplusplus",
            'extern "C" {',
            "#endif",
            "",
            *(f"#define {name} {value}" for name, value in sizes.items()),
            "",
            "/* Where the parameters stand among the values of an estimate. */",
            "enum {",
            *names,
            "};",
            "",
            "/* How the filter starts. */",
            *_struct(filter.start, "palpate_start_settings"),
            "",
            "/* Numbers of every step. */",
            *_struct(filter.step, "palpate_step_settings"),
            "",
            part("api.h"),
        ]
    )


def source(filter: ExportedTrack, defaults: Sequence[str]) -> str:
    """``palpate_filter.c``: the whole filter in one file."""
    opening = part("opening.c") if _fits(filter) else ""
    pieces = [
        "\n".join(_preamble(filter)),
        c_function(
            "step", step_function(filter.recursion.step), ("state", "sample", "settings"), ("next_state", "output")
        ),
        c_function("force_columns", filter.columns(), ("point", "guess"), ("column",)) if opening else "",
        c_function("chart_of", filter.chart(), ("theta",), ("chart",)) if filter.kind == "kinematic" else "",
        part("touch.c"),
        part(f"{filter.kind}.c").replace("OPENING\n", opening),
        part("tracker.c"),
        "\n".join(_defaults(filter, defaults)),
    ]
    return "\n".join(piece for piece in pieces if piece)


def share(rate: float) -> int:
    """Readings that the work of one sample may look at."""
    return math.ceil(_SHARE / rate)


def _longest(tare_duration: float, touch_lag: float) -> float:
    """For how long [s] readings are looked back over."""
    return max(_BASELINE + touch_lag, tare_duration + (1.0 + _AFTER) * touch_lag)


def _waiting(filter: ExportedTrack, rate: float, tare_duration: float, touch_lag: float) -> float:
    """How long [s] the searches take at most, while samples come in: for tare, touch and start."""
    searches = 4 * _CHANGE * rate * _longest(tare_duration, touch_lag) / _SHARE
    fit = _FIT * rate * filter.window / _SHARE if _fits(filter) else 0.0
    late = sum(
        max(fit * (1.0 + 0.2 * k) - 0.2 * filter.window, 0.0) for k in range(16)
    )  # each waits for the one before
    return searches + fit + late


def _window(filter: ExportedTrack, rate: float) -> int:
    return math.ceil(_MARGIN * rate * _LONGEST * filter.window) + 16 if filter.window > 0 else 0


def _fits(filter: ExportedTrack) -> bool:
    return filter.window > 0 and bool(filter.fitted)


def _upper(name: str) -> str:
    return re.sub(r"\W+", "_", name).upper()


def _struct(settings: Sequence[SettingGroup], name: str) -> Iterator[str]:
    yield "typedef struct {"
    for one in settings:
        size = f"[{len(one.values)}]" if one.array else ""
        yield f"    double {one.name}{size}; /* {one.about} */"
    yield f"}} {name};"


def _preamble(filter: ExportedTrack) -> Iterator[str]:
    state, place = filter.state, filter.output
    step = filter.recursion.step
    yield from ('#include "palpate_filter.h"', "", "#include <limits.h>", "#include <math.h>", "")
    yield from ("#ifdef __FAST_MATH__", "#error the numbers of this filter need exact arithmetic: no -ffast-math")
    yield from ("#endif", "")
    yield f"#define BIASED {int('bias' in state)}"
    yield f"#define FITTABLE {int(_fits(filter))}"
    yield f"#define DRIFTING {int('drift' in state)}"
    yield f"#define TIP_MASS {c_number(filter.mass)} /* [kg] */"
    yield f"#define PAUSE {c_number(PAUSE)} /* [s]; over a longer one the measured position carries the depth */"
    yield f"#define FIT_SPREAD {c_number(filter.fit_spread)} /* the filter sees the fitted samples again */"
    if filter.kind == "kinematic":
        yield f"#define ACCELERATION_STD {c_number(filter.acceleration_std)} /* [m/s^2] */"
    yield ""
    sizes = {
        "STATES": state.size,
        "INPUTS": step.sample.numel(),
        "OUTPUTS": step.output.numel(),
        "STEP_SETTINGS": step.settings.numel(),
        "FITTED": len(filter.fitted),
    }
    yield f"enum {{ {', '.join(f'{name} = {size}' for name, size in sizes.items())} }};"
    yield _places("AT", _renamed(state, filter.parameters))
    yield _places("AT", {"MEAN": filter.carried["mean"].start, "COVARIANCE": filter.carried["covariance"].start})
    yield _places("AT", {name.upper(): filter.carried[name].start for name in filter.carried if name not in _BOTH})
    yield _places("OUT", {name.upper(): place[name].start for name in place if name not in _BOTH})
    if _fits(filter):
        yield f"static const int fitted[] = {{{', '.join(map(str, filter.fitted))}}};"
    yield ""


_BOTH = ("mean", "covariance")


def _renamed(state: Layout, parameters: str) -> dict[str, int]:
    """Where the parts of the state stand; those that are absent at -1."""
    found = {"CHART" if name == parameters else name.upper(): state[name] for name in state}
    return {name: rows.start if rows.start < rows.stop else -1 for name, rows in found.items()}


def _places(prefix: str, places: dict[str, int]) -> str:
    return f"enum {{ {', '.join(f'{prefix}_{name} = {place}' for name, place in places.items())} }};"


def _defaults(filter: ExportedTrack, defaults: Sequence[str]) -> Iterator[str]:
    yield "void palpate_defaults(palpate_settings *settings)"
    yield "{"
    yield from (f"    settings->{line};" for line in defaults)
    for struct, settings in (("start", filter.start), ("step", filter.step)):
        for one in settings:
            for i, value in enumerate(one.values):
                yield f"    settings->{struct}.{one.name}{f'[{i}]' if one.array else ''} = {c_number(value)};"
    yield "}"
    yield ""
