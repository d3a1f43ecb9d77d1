"""``palpate fit spectrum``: storage and loss modulus over frequency, from one or many recordings of one specimen."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer
from palpate import ConfigurationError, Flag
from palpate_engine import display_unit, make_folder, write_new
from palpate_kit.terminal.json_output import print_aside, print_json
from palpate_kit.terminal.options import FolderOption, FormatOption, JsonOption, TrackOption
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table, console

from palpate_spectra.command_options import SurfaceOption, parse_height, parse_quantities
from palpate_spectra.complex_moduli import ModulusLine, RecordingModuli, measure_moduli
from palpate_spectra.consistency import Consistency, harmonics, kramers_kronig
from palpate_spectra.flags import evidence_sentence, flags_of, parameter_text
from palpate_spectra.law_fits import LawFit, law_fits
from palpate_spectra.recorded_oscillation import read_oscillation
from palpate_spectra.spectrum_figure import draw

# Columns that a narrow screen leaves out.
_SPARE_OF_MODULI = 3  # the amplitude, and E, which is a multiple of G
_SPARE_OF_LAWS = 2  # BIC, and chi^2, which p stands for
_ONE_DEPTH_SHARE = 0.01  # of the largest depth: depths that differ by less are printed as one; a choice


def spectrum(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="Run folders, logs or pipeline files; of one specimen.")
    ],
    track: TrackOption = None,
    frequencies: Annotated[
        str | None, typer.Option(help='Of the motion, separated by commas: "0.5 Hz, 2 Hz". [default: found]')
    ] = None,
    surface: SurfaceOption = None,
    out: FolderOption = None,
    as_json: JsonOption = False,
    layout: FormatOption = "table",
) -> None:
    """Print G', G'', E', E'' and tan(delta) over frequency; draw them, and write them as CSV.

    From sines, several at once, chirps and stepped frequencies, on any tip with a contact radius. Checks Kramers and
    Kronig's relations and the harmonics, and fits laws of the material with a delay of the force.
    """
    stated_frequencies = parse_quantities(frequencies, "Hz", "--frequencies")
    height = parse_height(surface)
    recordings = [measure_moduli(read_oscillation(run, track, height), stated_frequencies) for run in runs]
    lines = sorted((line for moduli in recordings for line in moduli.lines), key=lambda line: line.frequency)
    if not lines:
        raise ConfigurationError(f"{runs[0]}: the motion is neither a sum of sines nor a sine whose frequency changes")
    consistency, fits = kramers_kronig(lines), law_fits(lines)
    flags = flags_of(recordings, lines, consistency, fits)
    folder = make_folder("spectrum", out, datetime.now(UTC).astimezone())
    write_new(folder / "spectrum.csv", csv_text(lines))
    draw(lines, fits, folder / "spectrum.png")
    if as_json:
        summary = document(recordings, lines, consistency, fits)
        print_json({"folder": folder, **summary, "flags": [flag.table() for flag in flags]})
        return
    with print_aside(False):
        _print_spectrum(lines, fits, consistency, flags)
    typer.echo(f"written to {folder}: spectrum.csv, spectrum.png", err=layout != "table")


def _print_spectrum(
    lines: Sequence[ModulusLine], fits: Sequence[LawFit], consistency: Consistency, flags: Sequence[Flag]
) -> None:
    """Print the moduli, the laws, the evidence and the flags for a person."""
    screen = console()
    screen.print(moduli_table(lines).view(), highlight=False)
    if fits:
        screen.print(law_table(fits).view(), highlight=False)
    screen.print(evidence_sentence(fits, lines), highlight=False)
    screen.print(_consistency_sentence(consistency), highlight=False)
    for flag in flags:
        screen.print(str(flag), style="yellow", markup=False, highlight=False)


def moduli_table(lines: Sequence[ModulusLine]) -> Table:
    """Return the moduli in display units, each with its standard uncertainty; with runs where there are several."""
    has_several_runs = len({line.run for line in lines}) > 1
    run_heading = ["run"] if has_several_runs else []
    unit, factor = display_unit("Pa")
    moduli_headings = [f"G'\n{unit}", f"G''\n{unit}", "tan(delta)", "amplitude\nmm", f"E'\n{unit}", f"E''\n{unit}"]
    headings = ["f\nHz", *run_heading, *moduli_headings]
    rows = []
    for line in lines:
        shear, young, young_over_shear = line.shear, line.young, 2 * (1 + line.poisson)
        storage_std, loss_std = line.std_of("storage"), line.std_of("loss")
        rows.append(
            [
                f"{line.frequency:.4g}",
                *([line.run] if has_several_runs else []),
                value_with_uncertainty(factor * shear.real, factor * storage_std),
                value_with_uncertainty(factor * shear.imag, factor * loss_std),
                value_with_uncertainty(line.loss_tangent, line.std_of("tan")),
                f"{1e3 * line.amplitude:.3g}",
                value_with_uncertainty(factor * young.real, factor * young_over_shear * storage_std),
                value_with_uncertainty(factor * young.imag, factor * young_over_shear * loss_std),
            ]
        )
    return replace(Table.of(_moduli_title(lines), headings, rows, ["run"]), spare=_SPARE_OF_MODULI)


def _moduli_title(lines: Sequence[ModulusLine]) -> str:
    """Return the depths [mm] of the lines, and the ratios of E to G."""
    depths = [line.depth for line in lines]
    low, high = 1e3 * min(depths), 1e3 * max(depths)
    is_one_depth = high - low < _ONE_DEPTH_SHARE * high
    depth_text = f"{low:.3g} mm" if is_one_depth else f"{low:.3g} to {high:.3g} mm"
    ratios = sorted({2 * (1 + line.poisson) for line in lines})
    return f"around a depth of {depth_text}; E is {' or '.join(f'{ratio:.3g}' for ratio in ratios)} G"


def law_table(fits: Sequence[LawFit]) -> Table:
    """Return the laws, their parameters and delays, and the evidence for each."""
    headings = ["law", "values", "late\nms", "p", "BIC", "chi^2 / freedom"]
    rows = [
        [
            fit.law.name,
            parameter_text(fit),
            _delay_text(fit),
            f"{fit.p:.2g}",
            f"{fit.bic:.4g}",
            f"{fit.chi2:.3g} / {fit.freedom}",
        ]
        for fit in fits
    ]
    table = Table.of("a law and a delay of the force together", headings, rows, ["law", "values"])
    return replace(table, spare=_SPARE_OF_LAWS)


def _delay_text(fit: LawFit) -> str:
    """Return the delay of a law [ms], or that it is the declared one."""
    return "as declared" if math.isnan(fit.delay_std) else value_with_uncertainty(1e3 * fit.delay, 1e3 * fit.delay_std)


def _consistency_sentence(consistency: Consistency) -> str:
    """Return the outcome of Kramers and Kronig's test in words."""
    if not consistency.freedom:
        return "Kramers-Kronig: too few frequencies to decide"
    verdict = "not those of one passive linear material" if consistency.failed else "consistent"
    return (
        f"Kramers-Kronig: {verdict} (chi^2 {consistency.chi2:.3g}, {consistency.freedom} degrees of freedom, "
        f"p = {consistency.p:.2g})"
    )


def csv_text(lines: Sequence[ModulusLine]) -> str:
    """Return all lines, at least one, as CSV [SI]."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    rows = [_line_numbers(line) for line in lines]
    writer.writerow(["run", *rows[0]])
    for line, row in zip(lines, rows, strict=True):
        writer.writerow([line.run, *(f"{value:.10g}" for value in row.values())])
    return text.getvalue()


def _line_numbers(line: ModulusLine) -> dict[str, float]:
    """Return the numbers of a line, by column [SI]."""
    shear, young_over_shear = line.shear, 2 * (1 + line.poisson)
    storage_std, loss_std = line.std_of("storage"), line.std_of("loss")
    return {
        "frequency_Hz": line.frequency,
        "amplitude_m": line.amplitude,
        "depth_m": line.depth,
        "G_storage_Pa": shear.real,
        "G_storage_std_Pa": storage_std,
        "G_loss_Pa": shear.imag,
        "G_loss_std_Pa": loss_std,
        "E_storage_Pa": young_over_shear * shear.real,
        "E_storage_std_Pa": young_over_shear * storage_std,
        "E_loss_Pa": young_over_shear * shear.imag,
        "E_loss_std_Pa": young_over_shear * loss_std,
        "tan_delta": line.loss_tangent,
        "tan_delta_std": line.std_of("tan"),
        "noise_std_Pa": line.noise,
        "noise_freedom": line.freedom,
    }


def document(
    recordings: Sequence[RecordingModuli],
    lines: Sequence[ModulusLine],
    consistency: Consistency,
    fits: Sequence[LawFit],
) -> dict[str, Any]:
    """Return the spectrum, its tests and its laws as plain data [SI]."""
    return {
        "lines": [
            {
                "run": line.run,
                **_line_numbers(line),
                "shifts": {source: [shift.real, shift.imag] for source, shift in line.shifts.items()},
            }
            for line in lines
        ],
        "kramers_kronig": consistency,
        "harmonics": {moduli.recording.name: harmonics(moduli) for moduli in recordings},
        "laws": [_law_document(fit) for fit in fits],
        "sentence": evidence_sentence(fits, lines),
    }


def _law_document(fit: LawFit) -> dict[str, Any]:
    """Return a law's fit as plain data [SI]."""
    parameters = zip(fit.law.parameters, fit.values.tolist(), fit.stds.tolist(), strict=True)
    return {
        "law": fit.law.name,
        "delay": fit.delay,
        "delay_std": fit.delay_std,
        "chi2": fit.chi2,
        "p": fit.p,
        "freedom": fit.freedom,
        "bic": fit.bic,
        "scatter": fit.scatter,
        "parameters": {name: {"value": value, "std": std, "unit": unit} for (name, unit), value, std in parameters},
    }
