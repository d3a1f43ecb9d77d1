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
_FAR = 3.0  # standard uncertainties of a delay


def flags_of(
    answers: Sequence[RecordingModuli], lines: Sequence[ModulusLine], consistency: Consistency, fits: Sequence[LawFit]
) -> list[Flag]:
    """Return all flags, those of the recordings first."""
    found = [flag for answer in answers for flag in answer.recorded.flags]
    found += [flag for answer in answers for flag in _harmonics(answer)]
    found += _timing(answers, lines)
    if consistency.failed:
        found.append(
            Flag(
                "kramers-kronig",
                f"the nearest passive material leaves chi^2 {consistency.chi2:.3g} with {consistency.freedom} degrees "
                f"of freedom (p = {consistency.p:.1e})",
            )
        )
    return list(dict.fromkeys([*found, *_laws(answers, fits)]))


def _harmonics(answer: RecordingModuli) -> Iterator[Flag]:
    worst = sorted(unexplained_harmonics(answer), key=lambda one: -one.excess)
    if worst:
        text = ", ".join(f"{1e3 * one.excess:.2g} mN at {one.frequency:.3g} Hz" for one in worst[:3])
        yield Flag("harmonics", f"{answer.recorded.name}: {text} beyond what the tip's law explains")


def _timing(answers: Sequence[RecordingModuli], lines: Sequence[ModulusLine]) -> Iterator[Flag]:
    if any(answer.recorded.timing is None for answer in answers):
        slope = max(abs(line.by_delay.imag / line.shear.real) for line in lines)
        yield Flag("timing-undeclared", f"1 ms between force and motion changes tan(delta) by up to {1e-3 * slope:.2g}")
    hidden = [line for line in lines if abs(line.shear.imag) < 2 * abs(line.shifts.get("timing", 0j).imag)]
    if hidden:
        text = ", ".join(f"{line.frequency:.3g}" for line in hidden)
        yield Flag(
            "loss-not-distinguishable", f"at {text} Hz G'' is below twice the effect of the timing's uncertainty"
        )


def _laws(answers: Sequence[RecordingModuli], fits: Sequence[LawFit]) -> Iterator[Flag]:
    if not fits:
        return
    standing = supported_laws(fits)
    if not standing:
        text = ", ".join(f"{fit.law.name} p = {fit.p:.1e}" for fit in fits)
        yield Flag("no-law", f"refuted, with a free delay: {text}")
        return
    allowed = max((answer.recorded.timing or 0.0 for answer in answers), default=0.0)
    if any(answer.recorded.timing is None for answer in answers):
        return
    if all(abs(fit.delay) > _FAR * (fit.delay_std**2 + allowed**2) ** 0.5 for fit in standing):
        text = ", ".join(f"{1e3 * fit.delay:.3g} ± {1e3 * fit.delay_std:.2g} ms ({fit.law.name})" for fit in standing)
        yield Flag("delay-found", f"the force is late by {text}; declared: 0 ± {1e3 * allowed:.2g} ms")


def sentence(fits: Sequence[LawFit], lines: Sequence[ModulusLine]) -> str:
    """Return the data's evidence on law and delay, as one sentence."""
    if not several_frequencies(lines):
        text = "One frequency cannot distinguish a delay from a loss: record another, or calibrate the timing."
        return f"{text} {between(fits)}".strip()
    if not fits:
        return "So few frequencies cannot test a law with a free delay."
    standing = supported_laws(fits)
    if not standing:
        return "None of the laws, each with a delay of the force, describes the data."
    best = standing[0]
    text = f"The data support {' or '.join(fit.law.name for fit in standing)}"
    refuted = [fit.law.name for fit in fits if fit not in standing]
    text += f" (not {', not '.join(refuted)})" if refuted else ""
    text = f"{text}; under {best.law.name} the force is late by {1e3 * best.delay:.3g} ± {1e3 * best.delay_std:.2g} ms."
    return f"{text} {between(standing)}".strip()


def between(fits: Sequence[LawFit]) -> str:
    """Return how far recordings scatter under the best law; nothing of a single one."""
    if not fits or fits[0].scatter.recordings < 2:
        return ""
    known = fits[0].scatter
    shares = f"{100 * known.storage:.2g} % in G' and {100 * known.loss:.2g} % in G''"
    return f"Beyond what they state, the {known.recordings} recordings scatter by {shares}."


def values_of(fit: LawFit) -> str:
    """Return the parameters of a law by their symbols, in display units."""
    text = []
    for (name, unit), value, std in zip(fit.law.parameters, fit.values.tolist(), fit.stds.tolist(), strict=True):
        word, factor = display_unit(unit)
        number = value_with_uncertainty(factor * value, factor * std)
        text.append(f"{_SYMBOLS.get(name, name)} {number} {word}".removesuffix(" 1"))
    return "\n".join(text)
