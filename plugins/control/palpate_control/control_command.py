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

_MAX_ROWS = 15  # checks in the table, the latest: a choice, they fit a screen
_LIMIT_DIGITS = 3  # of a limit, and of a distance that is compared with it
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
        control_chart = read_chart(chart)
    else:
        control_chart = _with_run(run, _reference(reference, uncertainty, chart), chart, track)
    if not control_chart.check:
        raise ConfigurationError(f"{chart}: holds no check yet")
    if plot is not None:
        from palpate_control.chart_figure import draw_chart

        draw_chart(control_chart, plot)
    if as_json:
        print_json(_document(control_chart, chart))
        return
    screen = console()
    screen.print(_table(control_chart).view())
    for line in _lines(control_chart, chart):
        screen.print(line, highlight=False, markup=False)


def _reference(reference: str | None, uncertainty: str | None, path: Path) -> Reference:
    """Return the reference of the command line; without one that of the chart. Raises ConfigurationError."""
    if reference is not None:
        return read_reference(reference, uncertainty)
    if uncertainty is not None:
        raise ConfigurationError("--uncertainty without --reference: state both, or neither where the chart has them")
    if not path.exists():
        raise ConfigurationError(
            '--reference is missing: what the specimen is known to be, such as "112.5 kPa", or a TOML file'
        )
    reference_entry = read_chart(path).reference
    return Reference(reference_entry.name, reference_entry.value, reference_entry.unit, reference_entry.std)


def _with_run(run: Path, reference: Reference, path: Path, track: str | None) -> ControlChart:
    """Append a run to the chart, and return it; raises UserError where the run does not belong there."""
    chart = read_chart(path) if path.exists() else None
    run_check = check_of_run(run, reference, track or (chart.track if chart else None))
    # A reference that is known for one tip is not compared with another.
    tip = reference.tip if run_check.tip else None
    if tip is not None and not is_same_tip(tip, run_check.tip, registry.load()):
        raise ConfigurationError(
            f"{run}: its tip is {settings_text(run_check.tip)}; the reference is for {settings_text(tip)}"
        )
    if chart is not None:
        _demand_same(chart, run_check, reference, run, path)
    chart_reference = ChartReference(name=reference.name, value=reference.value, unit=reference.unit, std=reference.std)
    new_chart = ControlChart(
        quantity=reference.quantity,
        track=run_check.track,
        reference=chart_reference,
        tip=run_check.tip,
        sensor=run_check.sensor,
        robot=run_check.robot,
    )
    return append_check(path, new_chart, run_check.check)


def _demand_same(chart: ControlChart, run_check: RunCheck, reference: Reference, run: Path, path: Path) -> None:
    """Raise ConfigurationError where a run is of another reference, track, tip, sensor or robot than the chart's."""
    charted, hint = chart.reference, "--chart FILE begins another one"
    if (charted.value, charted.unit, charted.std) != (reference.value, reference.unit, reference.std):
        unit, factor = display_unit(charted.unit)
        text = f"{charted.name} of {factor * charted.value:.6g} ± {factor * charted.std:.3g} {unit}"
        raise ConfigurationError(f"{path}: is the chart of another reference, {text}; {hint}")
    if chart.track != run_check.track:
        text = f"the chart {path} is of the track {chart.track}, not {run_check.track}"
        raise ConfigurationError(f"{run}: {text}; {hint}")
    if chart.tip != run_check.tip:  # by another law of the same ball the values are others
        text = f"{settings_text(run_check.tip)}, in the chart {path} {settings_text(chart.tip)}"
        raise ConfigurationError(f"{run}: another tip than the chart's: {text}; {hint}")
    for role in ("sensor", "robot"):
        charted_identity, identity = getattr(chart, role), getattr(run_check, role)
        if (key := other_identity(charted_identity, identity)) is not None:
            text = f"{key.replace('_', ' ')} {identity[key]}, in the chart {path} {charted_identity[key]}"
            raise ConfigurationError(f"{run}: another {role} than the chart's: {text}; {hint}")


def _table(chart: ControlChart) -> Table:
    """Return the table of the last checks, with both uncertainties, E_n, and distances with their limits."""
    unit, factor = display_unit(chart.reference.unit)  # the unit that is shown, and its number per SI unit
    rows = []
    numbered_checks = list(enumerate(zip(chart.check, chart.states, strict=True), 1))
    for number, (check, state) in numbered_checks[-_MAX_ROWS:]:
        rows.append(
            (
                f"{number}",
                f"{check.date:%Y-%m-%d %H:%M}",
                value_with_uncertainty(factor * check.value, factor * check.std),
                f"{state.e_n:+.2f}",
                *_distance_texts(factor * (check.value - state.centre), factor * state.limit),
                *_distance_texts(factor * (state.ewma - state.centre), factor * state.ewma_limit),
                "in control" if state.in_control else "out of control",
            )
        )
    headings = ("", "date", f"{chart.quantity}\n{unit}", "E_n", "from\ncentre", "3 sigma", "EWMA", "limit", "state")
    reference = value_with_uncertainty(factor * chart.reference.value, factor * chart.reference.std)
    return Table.of(f"{chart.reference.name}, {chart.quantity} {reference} {unit}", headings, rows, ("date", "state"))


def _distance_texts(distance: float, limit: float) -> tuple[str, str]:
    """Return a distance from the centre and its limit, to three digits of the limit; empty without a limit.

    >>> _distance_texts(0.0672, 1.33)
    ('+0.07', '1.33')
    """
    if not limit:
        return "", ""
    digits = max(0, _LIMIT_DIGITS - 1 - math.floor(math.log10(limit)))
    return f"{distance:+.{digits}f}", f"{limit:.{digits}f}"


def _lines(chart: ControlChart, path: Path) -> Iterator[str]:
    """Yield the verdict of the last check with its reasons, the source of the limits, and the use of the chart."""
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
    """Return the chart with the states of its checks, in SI."""
    checks = [
        {**check.model_dump(mode="json"), "in_control": state.in_control, "state": state}
        for check, state in zip(chart.check, chart.states, strict=True)
    ]
    return {"file": path, **chart.model_dump(mode="json", exclude={"check"}), "checks": checks}
