"""``palpate calibrate control``: a run on a reference of known stiffness becomes a check in the rig's chart."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer
from palpate import ConfigurationError
from palpate_engine import display_unit, is_same_tip, registry
from palpate_kit.runs.device_identity import other_identity
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import FormatOption, JsonOption, TrackOption
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table, console

from palpate_control.chart_file import ChartReference, ControlChart, append_check, read_chart
from palpate_control.chart_use import settings_text
from palpate_control.control_limits import BASELINE
from palpate_control.reference import Reference, read_reference
from palpate_control.run_check import RunCheck, check_of_run

_ROWS = 15  # checks in the table
_CHART = Path("control.toml")


def control(
    run: Annotated[
        Path | None, typer.Argument(metavar="[RUN]", help="A run on the reference; left out: show the chart.")
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(
            metavar="VALUE|FILE", help='What it is known to be, "112.5 kPa" or "3.2 N/mm" of a spring; or a TOML file.'
        ),
    ] = None,
    uncertainty: Annotated[
        str | None,
        typer.Option(metavar="VALUE", help='Its standard uncertainty (k = 1), such as "1.5 kPa".'),
    ] = None,
    chart: Annotated[Path, typer.Option(help="The chart of this robot, sensor and tip.")] = _CHART,
    track: TrackOption = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the chart into this file (.png, .svg or .pdf).")] = None,
    as_json: JsonOption = False,
    layout: FormatOption = "table",
) -> None:
    """Compare a run on a reference specimen, or a spring, with its known value, and append it to the rig's chart.

    E_n compares value and reference by their expanded uncertainties (ISO 13528); Shewhart's chart and an EWMA (ISO
    7870) show what changes from check to check. A pipeline takes the chart by [run] control.
    """
    if run is None:
        if reference is not None or uncertainty is not None:
            raise ConfigurationError("name the RUN on the reference; without one the chart is only shown")
        whole = read_chart(chart)
    else:
        whole = _with_run(run, _stated(reference, uncertainty, chart), chart, track)
    if not whole.check:
        raise ConfigurationError(f"{chart}: holds no check yet")
    if plot is not None:
        from palpate_control.chart_figure import draw_chart

        draw_chart(whole, plot)
    if as_json:
        print_json(_document(whole, chart))
        return
    screen = console()
    screen.print(_table(whole).view())
    for line in _lines(whole, chart):
        screen.print(line, highlight=False, markup=False)


def _stated(reference: str | None, uncertainty: str | None, path: Path) -> Reference:
    """The reference of the command line; without one that of the chart."""
    if reference is not None:
        return read_reference(reference, uncertainty)
    if uncertainty is not None:
        raise ConfigurationError("--uncertainty without --reference: state both, or neither where the chart has them")
    if not path.exists():
        raise ConfigurationError(
            '--reference is missing: what the specimen is known to be, such as "112.5 kPa", or a TOML file'
        )
    known = read_chart(path).reference
    return Reference(known.name, known.value, known.unit, known.std)


def _with_run(run: Path, reference: Reference, path: Path, track: str | None) -> ControlChart:
    """The chart with a run appended; raises UserError where the run does not belong there."""
    before = read_chart(path) if path.exists() else None
    checked = check_of_run(run, reference, track or (before.track if before else None))
    known = registry.load()
    if reference.tip is not None and checked.tip and not is_same_tip(reference.tip, checked.tip, known):
        raise ConfigurationError(
            f"{run}: its tip is {settings_text(checked.tip)}; the reference is for {settings_text(reference.tip)}"
        )
    if before is not None:
        _demand_same(before, checked, reference, run, path)
    of_chart = ChartReference(name=reference.name, value=reference.value, unit=reference.unit, std=reference.std)
    new = ControlChart(
        quantity=reference.quantity,
        track=checked.track,
        reference=of_chart,
        tip=checked.tip,
        sensor=checked.sensor,
        robot=checked.robot,
    )
    return append_check(path, new, checked.check)


def _demand_same(chart: ControlChart, checked: RunCheck, reference: Reference, run: Path, path: Path) -> None:
    """Raise ConfigurationError where a run is of another reference, track, tip, sensor or robot than the chart's."""
    known, other = chart.reference, "--chart FILE begins another one"
    if (known.value, known.unit, known.std) != (reference.value, reference.unit, reference.std):
        word, factor = display_unit(known.unit)
        is_of = f"{known.name} of {factor * known.value:.6g} ± {factor * known.std:.3g} {word}"
        raise ConfigurationError(f"{path}: is the chart of another reference, {is_of}; {other}")
    if chart.track != checked.track:
        raise ConfigurationError(f"{run}: the chart {path} is of the track {chart.track}, not {checked.track}; {other}")
    if chart.tip != checked.tip:  # by another law of the same ball the values are others
        tips = f"{settings_text(checked.tip)}, in the chart {path} {settings_text(chart.tip)}"
        raise ConfigurationError(f"{run}: another tip than the chart's: {tips}; {other}")
    for word in ("sensor", "robot"):
        before, present = getattr(chart, word), getattr(checked, word)
        if (key := other_identity(before, present)) is not None:
            both = f"{key.replace('_', ' ')} {present[key]}, in the chart {path} {before[key]}"
            raise ConfigurationError(f"{run}: another {word} than the chart's: {both}; {other}")


def _table(chart: ControlChart) -> Table:
    """The last checks, with both uncertainties, E_n and what the limits allow."""
    word, factor = display_unit(chart.reference.unit)
    known = value_with_uncertainty(factor * chart.reference.value, factor * chart.reference.std)
    rows = []
    states = chart.states
    for number, (check, state) in list(enumerate(zip(chart.check, states, strict=True), 1))[-_ROWS:]:
        rows.append(
            (
                f"{number}",
                f"{check.date:%Y-%m-%d %H:%M}",
                value_with_uncertainty(factor * check.value, factor * check.std),
                f"{state.e_n:+.2f}",
                *_within(factor * (check.value - state.centre), factor * state.limit),
                *_within(factor * (state.ewma - state.centre), factor * state.ewma_limit),
                "in control" if state.in_control else "out of control",
            )
        )
    headings = ("", "date", f"{chart.quantity}\n{word}", "E_n", "from\ncentre", "3 sigma", "EWMA", "limit", "state")
    return Table.of(f"{chart.reference.name}, {chart.quantity} {known} {word}", headings, rows, ("date", "state"))


def _within(distance: float, limit: float) -> tuple[str, str]:
    """A distance from the centre and its limit, to three digits of the limit; nothing before there is any.

    >>> _within(0.0672, 1.33)
    ('+0.07', '1.33')
    """
    if not limit:
        return "", ""
    digits = max(0, 2 - math.floor(math.log10(limit)))
    return f"{distance:+.{digits}f}", f"{limit:.{digits}f}"


def _lines(chart: ControlChart, path: Path) -> Iterator[str]:
    """Verdict of the last check, why, where the limits come from, and what to do with the chart."""
    state = chart.states[-1]
    sensor, robot = (settings_text(facts) if facts else "not identified" for facts in (chart.sensor, chart.robot))
    yield f"track {chart.track}; tip: {settings_text(chart.tip)}; sensor: {sensor}; robot: {robot}"
    if state.own_scatter:
        yield f"limits: by the scatter of the first {BASELINE} checks in control"
    else:
        yield f"limits: by the stated uncertainties, until {BASELINE} checks in control give the chart's own scatter"
    yield f"E_n {state.e_n:.2f}: {'in control' if state.in_control else 'out of control'}"
    yield from (f"  {reason}" for reason in state.reasons)
    yield f'a pipeline takes the chart by [run] control = "{path.resolve()}"'


def _document(chart: ControlChart, path: Path) -> dict[str, Any]:
    """Everything that is known, in SI."""
    checks = [
        {**check.model_dump(mode="json"), "in_control": state.in_control, "state": state}
        for check, state in zip(chart.check, chart.states, strict=True)
    ]
    return {"file": path, **chart.model_dump(mode="json", exclude={"check"}), "checks": checks}
