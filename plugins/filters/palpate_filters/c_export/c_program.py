"""The C of an exported filter: its expressions, then the parts that are the same for all."""

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

_RISE_BLOCKS = 160  # a choice: blocks of the memory in which touch.c looks for a rise
_AIR_SAMPLES = 2000  # those of `palpate_filters.free_air`
_BASELINE = 1.0  # [s], as in touch.c: readings before the lag of a touch
_AFTER_LAG = 0.2  # touch lags, as in touch.c: readings after the lag
_MAX_WINDOW = 4.0  # start windows: the last patient attempt of `palpate_filters.filter_tracker` has one of 1 + 15 * 0.2
_WINDOW_GROWTH = 0.2  # start windows after each attempt, as there
_ATTEMPTS = 16  # on windows that grow, as there
_RATE_MARGIN = 1.1  # a choice: memory for a rate of samples that exceeds the declared one
_SPARE_SAMPLES = 16  # a choice: memory for rounding and the ends of smoothing
_READINGS_PER_SECOND = 2e6  # a choice: how many readings the work of a second may use on a slow controller
_CHANGE_POINT_PASSES = 4 * 41 + 5  # over the readings, in touch.c: CHANGE_LEVELS grids of CHANGE_GRID, and five more
_CHANGE_POINT_SEARCHES = 4  # that may follow one another before a start (a bound of 0290)
_FIT_PASSES = (
    6 * 110
)  # over the window, in opening.c: 59 misfits of the grid and those of the search, ROW readings each
_MATRICES = ("mean", "covariance")  # parts of a state that have constants of their own


def part(name: str) -> str:
    """Return the text of a part that is the same for all filters."""
    return (files("palpate_filters") / "c_export" / "c" / name).read_text("utf-8")


def header(filter: ExportedTrack, title: str, rate: float, tare_duration: float, touch_lag: float) -> str:
    """Return ``palpate_filter.h``: sizes, settings, functions.

    `rate` [Hz] of the samples, `tare_duration` [s] and `touch_lag` [s] of the search for a touch decide how many
    samples the C code keeps in memory.
    """
    duration = _memory_duration(tare_duration, touch_lag) + _search_duration(filter, rate, tare_duration, touch_lag)
    sizes = {
        "PALPATE_PARAMETERS": len(filter.model.parameters),
        "PALPATE_STATE": filter.carried.size,
        "PALPATE_RATE": c_number(rate) + " /* [Hz] that the memory is made for */",
        "PALPATE_RECORD": f"{_sample_count(rate, duration)} /* samples before the touch, or waiting */",
        "PALPATE_WINDOW": f"{_window_samples(filter, rate)} /* samples that it starts on */",
        "PALPATE_AIR": _AIR_SAMPLES if filter.measures_noise else 0,
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
    """Return ``palpate_filter.c``: the whole filter in one file.

    `defaults` are the assignments ``name = value`` of the settings that do not depend on the kind of filter.
    """
    # The C text of the fit from which a filter starts; empty for a filter that starts from its guess.
    opening = part("opening.c") if _has_fit(filter) else ""
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
    """Return the number of readings that the work of one sample may use."""
    return math.ceil(_READINGS_PER_SECOND / rate)


def _sample_count(rate: float, duration: float) -> int:
    """Return the samples of a duration [s] at a rate [Hz], with a margin."""
    return math.ceil(_RATE_MARGIN * rate * duration) + _SPARE_SAMPLES


def _memory_duration(tare_duration: float, touch_lag: float) -> float:
    """Return the time [s] over which the searches use past readings."""
    return max(_BASELINE + touch_lag, tare_duration + (1.0 + _AFTER_LAG) * touch_lag)


def _search_duration(filter: ExportedTrack, rate: float, tare_duration: float, touch_lag: float) -> float:
    """Return the longest time [s] of the searches for tare, touch and start, while samples come in."""
    passes = _CHANGE_POINT_SEARCHES * _CHANGE_POINT_PASSES
    searches = passes * rate * _memory_duration(tare_duration, touch_lag) / _READINGS_PER_SECOND
    fit = _FIT_PASSES * rate * filter.window / _READINGS_PER_SECOND if _has_fit(filter) else 0.0
    # A fit that takes longer than its window grows delays all later ones.
    delays = []
    for attempt in range(_ATTEMPTS):
        delays.append(max(fit * (1.0 + _WINDOW_GROWTH * attempt) - _WINDOW_GROWTH * filter.window, 0.0))
    return searches + fit + sum(delays)


def _window_samples(filter: ExportedTrack, rate: float) -> int:
    """Return the samples of the longest window of the start; 0 without a start window."""
    return _sample_count(rate, _MAX_WINDOW * filter.window) if filter.window > 0 else 0


def _has_fit(filter: ExportedTrack) -> bool:
    """Return True if the filter starts from a fit."""
    return filter.window > 0 and bool(filter.fitted)


def _upper(name: str) -> str:
    return re.sub(r"\W+", "_", name).upper()


def _struct(settings: Sequence[SettingGroup], name: str) -> Iterator[str]:
    yield "typedef struct {"
    for group in settings:
        size = f"[{len(group.values)}]" if group.array else ""
        yield f"    double {group.name}{size}; /* {group.about} */"
    yield f"}} {name};"


def _preamble(filter: ExportedTrack) -> Iterator[str]:
    """Yield the lines of C before the functions: constants, sizes, and the places of all parts of state and output."""
    # Rows of the process's state, columns of a step's output.
    state_layout, output_layout = filter.state, filter.output
    step = filter.recursion.step
    yield from ('#include "palpate_filter.h"', "", "#include <limits.h>", "#include <math.h>", "")
    yield from ("#ifdef __FAST_MATH__", "#error the numbers of this filter need exact arithmetic: no -ffast-math")
    yield from ("#endif", "")
    yield f"#define BIASED {int('bias' in state_layout)}"
    yield f"#define FITTABLE {int(_has_fit(filter))}"
    yield f"#define DRIFTING {int('drift' in state_layout)}"
    yield f"#define TIP_MASS {c_number(filter.mass)} /* [kg] */"
    yield f"#define PAUSE {c_number(PAUSE)} /* [s]; over a longer one the measured position carries the depth */"
    yield f"#define FIT_SPREAD {c_number(filter.fit_spread)} /* the filter sees the fitted samples again */"
    if filter.kind == "kinematic":
        yield f"#define ACCELERATION_STD {c_number(filter.acceleration_std)} /* [m/s^2] */"
    yield ""
    sizes = {
        "STATES": state_layout.size,
        "INPUTS": step.sample.numel(),
        "OUTPUTS": step.output.numel(),
        "STEP_SETTINGS": step.settings.numel(),
        "FITTED": len(filter.fitted),
    }
    yield f"enum {{ {', '.join(f'{name} = {size}' for name, size in sizes.items())} }};"
    carried = filter.carried  # rows of all that a step hands to the next: mean, covariance, counters
    yield _places("AT", _state_places(state_layout, filter.parameters))
    yield _places("AT", {"MEAN": carried["mean"].start, "COVARIANCE": carried["covariance"].start})
    yield _places("AT", {name.upper(): carried[name].start for name in carried if name not in _MATRICES})
    yield _places("OUT", {name.upper(): output_layout[name].start for name in output_layout if name not in _MATRICES})
    if _has_fit(filter):
        yield f"static const int fitted[] = {{{', '.join(map(str, filter.fitted))}}};"
    yield ""


def _state_places(state: Layout, parameters: str) -> dict[str, int]:
    """Return the first row of each part of the state; -1 for an absent one."""
    places = {}
    for part_name in state:
        rows = state[part_name]
        name = "CHART" if part_name == parameters else part_name.upper()
        places[name] = rows.start if rows.start < rows.stop else -1
    return places


def _places(prefix: str, places: dict[str, int]) -> str:
    return f"enum {{ {', '.join(f'{prefix}_{name} = {place}' for name, place in places.items())} }};"


def _defaults(filter: ExportedTrack, defaults: Sequence[str]) -> Iterator[str]:
    """Yield the lines of the C function that sets every setting to its default."""
    yield "void palpate_defaults(palpate_settings *settings)"
    yield "{"
    yield from (f"    settings->{line};" for line in defaults)
    for struct, settings in (("start", filter.start), ("step", filter.step)):
        for group in settings:
            for i, value in enumerate(group.values):
                index = f"[{i}]" if group.array else ""
                yield f"    settings->{struct}.{group.name}{index} = {c_number(value)};"
    yield "}"
    yield ""
