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
from palpate import ConfigurationError
from palpate_engine import display_unit, make_folder, write_new
from palpate_kit.terminal.json_output import print_aside, print_json
from palpate_kit.terminal.options import FolderOption, FormatOption, JsonOption, TrackOption
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table, console

from palpate_spectra.command_options import SurfaceOption, height_of, quantities
from palpate_spectra.complex_moduli import ModulusLine, RecordingModuli, answer
from palpate_spectra.consistency import Consistency, harmonics, kramers_kronig
from palpate_spectra.flags import flags_of, sentence, values_of
from palpate_spectra.law_fits import LawFit, law_fits
from palpate_spectra.recorded_oscillation import read_oscillation
from palpate_spectra.spectrum_figure import draw

_COLUMNS = (
    "run", "frequency_Hz", "amplitude_m", "depth_m", "G_storage_Pa", "G_storage_std_Pa", "G_loss_Pa", "G_loss_std_Pa",
    "E_storage_Pa", "E_storage_std_Pa", "E_loss_Pa", "E_loss_std_Pa", "tan_delta", "tan_delta_std", "noise_std_Pa",
    "noise_freedom",
)  # fmt: skip


_SPARE_OF_LAW = 2  # columns that a narrow screen leaves out: BIC and chi^2, of which p says the latter
_SPARE = 3  # columns that a narrow screen leaves out: the amplitude, and E, which is a multiple of G


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
    lines_given = quantities(frequencies, "Hz", "--frequencies")
    height = height_of(surface)
    answers = [answer(read_oscillation(run, track, height), lines_given) for run in runs]
    lines = sorted((line for one in answers for line in one.lines), key=lambda line: line.frequency)
    if not lines:
        raise ConfigurationError(f"{runs[0]}: the motion is neither a sum of sines nor a sine whose frequency changes")
    consistency, fits = kramers_kronig(lines), law_fits(lines)
    flags = flags_of(answers, lines, consistency, fits)
    folder = make_folder("spectrum", out, datetime.now(UTC).astimezone())
    write_new(folder / "spectrum.csv", csv_text(lines))
    draw(lines, fits, folder / "spectrum.png")
    if as_json:
        print_json(
            {"folder": folder, **document(answers, lines, consistency, fits), "flags": [f.table() for f in flags]}
        )
        return
    with print_aside(False):
        screen = console()
        screen.print(table_of(lines).view(), highlight=False)
        if fits:
            screen.print(law_table(fits).view(), highlight=False)
        screen.print(sentence(fits, lines), highlight=False)
        screen.print(_kramers_kronig(consistency), highlight=False)
        for flag in flags:
            screen.print(str(flag), style="yellow", markup=False, highlight=False)
    typer.echo(f"written to {folder}: spectrum.csv, spectrum.png", err=layout != "table")


def table_of(lines: Sequence[ModulusLine]) -> Table:
    """The moduli, each with its standard uncertainty."""
    several = len({line.run for line in lines}) > 1
    word, factor = display_unit("Pa")
    headings = ["f\nHz", f"G'\n{word}", f"G''\n{word}", "tan(delta)", "amplitude\nmm", f"E'\n{word}", f"E''\n{word}"]
    rows = []
    for line in lines:
        shear, young, ratio = line.shear, line.young, 2 * (1 + line.poisson)
        stds = line.std(of="storage"), line.std(of="loss")
        row = [
            value_with_uncertainty(factor * value, factor * std) for value, std in zip((shear.real, shear.imag), stds)
        ]
        row += [value_with_uncertainty(line.loss_tangent, line.std(of="tan")), f"{1e3 * line.amplitude:.3g}"]
        row += [
            value_with_uncertainty(factor * value, factor * ratio * std)
            for value, std in zip((young.real, young.imag), stds)
        ]
        rows.append([f"{line.frequency:.4g}", *([line.run] if several else []), *row])
    depths = [line.depth for line in lines]
    low, high = 1e3 * min(depths), 1e3 * max(depths)
    at = f"{low:.3g} mm" if high - low < 0.01 * high else f"{low:.3g} to {high:.3g} mm"
    ratios = sorted({2 * (1 + line.poisson) for line in lines})
    title = f"around a depth of {at}; E is {' or '.join(f'{ratio:.3g}' for ratio in ratios)} G"
    headings[1:1] = ["run"] if several else []
    return replace(Table.of(title, headings, rows, ["run"]), spare=_SPARE)


def law_table(fits: Sequence[LawFit]) -> Table:
    """Laws with their delay, and how they stand."""
    rows = [
        [
            fit.law.name, values_of(fit),
            _late_by(fit),
            f"{fit.p:.2g}", f"{fit.bic:.4g}", f"{fit.chi2:.3g} / {fit.freedom}",
        ]
        for fit in fits
    ]  # fmt: skip
    headings = ["law", "values", "late\nms", "p", "BIC", "chi^2 / freedom"]
    table = Table.of("a law and a delay of the force together", headings, rows, ["law", "values"])
    return replace(table, spare=_SPARE_OF_LAW)


def _late_by(fit: LawFit) -> str:
    """The delay of a law [ms]."""
    return "as declared" if math.isnan(fit.delay_std) else value_with_uncertainty(1e3 * fit.delay, 1e3 * fit.delay_std)


def _kramers_kronig(found: Consistency) -> str:
    if not found.freedom:
        return "Kramers-Kronig: too few frequencies to decide"
    word = "not those of one passive linear material" if found.failed else "consistent"
    return f"Kramers-Kronig: {word} (chi^2 {found.chi2:.3g}, {found.freedom} degrees of freedom, p = {found.p:.2g})"


def csv_text(lines: Sequence[ModulusLine]) -> str:
    """All lines [SI]."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for line in lines:
        writer.writerow([line.run, *(f"{value:.10g}" for value in _numbers(line).values())])
    return text.getvalue()


def _numbers(line: ModulusLine) -> dict[str, float]:
    """The numbers of a line, by column [SI]."""
    ratio, shear = 2 * (1 + line.poisson), line.shear
    storage, loss = line.std(of="storage"), line.std(of="loss")
    values = (
        line.frequency, line.amplitude, line.depth, shear.real, storage, shear.imag, loss, ratio * shear.real,
        ratio * storage, ratio * shear.imag, ratio * loss, line.loss_tangent, line.std(of="tan"), line.noise,
        line.freedom,
    )  # fmt: skip
    return dict(zip(_COLUMNS[1:], values, strict=True))


def document(
    answers: Sequence[RecordingModuli], lines: Sequence[ModulusLine], consistency: Consistency, fits: Sequence[LawFit]
) -> dict[str, Any]:
    """Everything as plain data [SI]."""
    return {
        "lines": [
            {
                "run": line.run,
                **_numbers(line),
                "shifts": {name: [shift.real, shift.imag] for name, shift in line.shifts.items()},
            }
            for line in lines
        ],
        "kramers_kronig": consistency,
        "harmonics": {one.recorded.name: harmonics(one) for one in answers},
        "laws": [
            {
                "law": fit.law.name, "delay": fit.delay, "delay_std": fit.delay_std, "chi2": fit.chi2, "p": fit.p,
                "freedom": fit.freedom, "bic": fit.bic, "scatter": fit.scatter,
                "parameters": {
                    name: {"value": value, "std": std, "unit": unit}
                    for (name, unit), value, std in zip(fit.law.parameters, fit.values.tolist(), fit.stds.tolist())
                },
            }
            for fit in fits
        ],
        "sentence": sentence(fits, lines),
    }  # fmt: skip
