"""The flags on a spectrum."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from palpate import Flag
from palpate_engine import display_unit
from palpate_kit.terminal.quantities import value_with_uncertainty

from palpate_spectra.complex_moduli import ModulusLine, RecordingModuli
from palpate_spectra.consistency import Consistency, unexplained_harmonics
from palpate_spectra.law_fits import LawFit, several_frequencies, supported_laws

_SYMBOLS = {  # of the parameters of the laws, as docs/spectrum.md has them
    "elasticity": "E",
    "viscosity": "eta",
    "power": "alpha",
    "relaxing_elasticity": "E_1",
    "relaxation_time": "tau",
}
_MAX_DELAY_SIGMAS = 3.0  # standard uncertainties of a delay that the declared timing allows: a choice
_HIDDEN_SIGMAS = 2  # standard uncertainties of the timing below which a loss modulus is not distinguishable: a choice
_LISTED_HARMONICS = 3  # of a recording, the largest: a choice


def flags_of(
    recordings: Sequence[RecordingModuli],
    lines: Sequence[ModulusLine],
    consistency: Consistency,
    fits: Sequence[LawFit],
) -> list[Flag]:
    """Return all flags of a spectrum, those of its recordings first."""
    flags = [flag for moduli in recordings for flag in moduli.recording.flags]
    flags += [flag for moduli in recordings for flag in _harmonic_flags(moduli)]
    flags += _timing_flags(recordings, lines)
    if consistency.failed:
        flags.append(
            Flag(
                "kramers-kronig",
                f"the nearest passive material leaves chi^2 {consistency.chi2:.3g} with {consistency.freedom} degrees "
                f"of freedom (p = {consistency.p:.1e})",
            )
        )
    flags += _law_flags(recordings, fits)
    return list(dict.fromkeys(flags))


def _harmonic_flags(moduli: RecordingModuli) -> Iterator[Flag]:
    """Yield the flag of a recording whose force has harmonics that the tip's law does not explain."""
    largest_first = sorted(unexplained_harmonics(moduli), key=lambda harmonic: -harmonic.excess)
    if largest_first:
        listed = ", ".join(
            f"{1e3 * harmonic.excess:.2g} mN at {harmonic.frequency:.3g} Hz"
            for harmonic in largest_first[:_LISTED_HARMONICS]
        )
        yield Flag("harmonics", f"{moduli.recording.name}: {listed} beyond what the tip's law explains")


def _timing_flags(recordings: Sequence[RecordingModuli], lines: Sequence[ModulusLine]) -> Iterator[Flag]:
    """Yield the flags of a timing that is not declared, and of loss moduli that it hides."""
    if any(moduli.recording.timing is None for moduli in recordings):
        slope = max(abs(line.delay_derivative.imag / line.shear.real) for line in lines)  # [1/s] of tan(delta)
        yield Flag("timing-undeclared", f"1 ms between force and motion changes tan(delta) by up to {1e-3 * slope:.2g}")
    hidden_frequencies = [
        line.frequency
        for line in lines
        if abs(line.shear.imag) < _HIDDEN_SIGMAS * abs(line.shifts.get("timing", 0j).imag)
    ]
    if hidden_frequencies:
        listed = ", ".join(f"{frequency:.3g}" for frequency in hidden_frequencies)
        yield Flag(
            "loss-not-distinguishable", f"at {listed} Hz G'' is below twice the effect of the timing's uncertainty"
        )


def _law_flags(recordings: Sequence[RecordingModuli], fits: Sequence[LawFit]) -> Iterator[Flag]:
    """Yield the flag of laws that are all refuted, or of a delay beyond the declared timing under every supported law.

    With a timing that is not declared no delay is too large.
    """
    if not fits:
        return
    supported = supported_laws(fits)
    if not supported:
        listed = ", ".join(f"{fit.law.name} p = {fit.p:.1e}" for fit in fits)
        yield Flag("no-law", f"refuted, with a free delay: {listed}")
        return
    timing_stds = [moduli.recording.timing for moduli in recordings]
    if any(std is None for std in timing_stds):
        return
    timing_std = max((std or 0.0 for std in timing_stds), default=0.0)
    if all(abs(fit.delay) > _MAX_DELAY_SIGMAS * (fit.delay_std**2 + timing_std**2) ** 0.5 for fit in supported):
        delays = [f"{1e3 * fit.delay:.3g} ± {1e3 * fit.delay_std:.2g} ms ({fit.law.name})" for fit in supported]
        yield Flag("delay-found", f"the force is late by {', '.join(delays)}; declared: 0 ± {1e3 * timing_std:.2g} ms")


def evidence_sentence(fits: Sequence[LawFit], lines: Sequence[ModulusLine]) -> str:
    """Return the data's evidence on law and delay, as one sentence, and the scatter between recordings as another."""
    if not several_frequencies(lines):
        text = "One frequency cannot distinguish a delay from a loss: record another, or calibrate the timing."
        return f"{text} {scatter_sentence(fits)}".strip()
    if not fits:
        return "So few frequencies cannot test a law with a free delay."
    supported = supported_laws(fits)
    if not supported:
        return "None of the laws, each with a delay of the force, describes the data."
    best = supported[0]
    text = f"The data support {' or '.join(fit.law.name for fit in supported)}"
    refuted_laws = [fit.law.name for fit in fits if fit not in supported]
    text += f" (not {', not '.join(refuted_laws)})" if refuted_laws else ""
    text = f"{text}; under {best.law.name} the force is late by {1e3 * best.delay:.3g} ± {1e3 * best.delay_std:.2g} ms."
    return f"{text} {scatter_sentence(supported)}".strip()


def scatter_sentence(fits: Sequence[LawFit]) -> str:
    """Return the scatter of recordings under the first of the fits, as a sentence; empty for a single recording."""
    if not fits or fits[0].scatter.recordings < 2:
        return ""
    scatter = fits[0].scatter
    shares = f"{100 * scatter.storage:.2g} % in G' and {100 * scatter.loss:.2g} % in G''"
    return f"Beyond what they state, the {scatter.recordings} recordings scatter by {shares}."


def parameter_text(fit: LawFit) -> str:
    """Return the parameters of a law by their symbols, in display units, one a line."""
    rows = []
    for (name, si_unit), value, std in zip(fit.law.parameters, fit.values.tolist(), fit.stds.tolist(), strict=True):
        unit, factor = display_unit(si_unit)
        number = value_with_uncertainty(factor * value, factor * std)
        rows.append(f"{_SYMBOLS.get(name, name)} {number} {unit}".removesuffix(" 1"))
    return "\n".join(rows)
