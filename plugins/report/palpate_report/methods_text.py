"""The methods section of a folder of fits: how its curves were measured, fitted, judged and compared."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping

from palpate import ContactModel, Indenter, PalpateError, printable, to_si
from palpate_engine import AlignmentSettings, Pipeline, display_unit, has_no_number, numbers_of
from palpate_kit.curves.replication_unit import compare_rows
from palpate_kit.numerics.group_comparison import GroupComparison
from palpate_kit.terminal.fact_line import quantity_text
from palpate_kit.terminal.quantities import value_with_uncertainty

from palpate_report.bibliography import keys_of, sources_of
from palpate_report.cited_text import CitedText, cite
from palpate_report.folder_facts import FolderFacts
from palpate_report.number_texts import readable
from palpate_report.typical_curves import outcome_of

UNSTATED = "[instrument: not stated]"
_MODELS = {
    "dimensionality-reduction": "the method of dimensionality reduction for a Kelvin-Voigt half-space",
    "kelvin-voigt": "the Kelvin-Voigt contact model",
    "hunt-crossley": "the Hunt-Crossley contact model",
    "hunt-crossley-free": "the Hunt-Crossley contact model with a free exponent",
    "standard-linear-solid": "the contact model of a standard linear solid",
    "jkr": "the JKR model of adhesive contact",
    "dmt": "the DMT model of adhesive contact",
    "fung": "the Fung model of a stiffening tissue",
    "poroelastic": "the contact model of a poroelastic half-space",
}
_TIPS = {"flat": "flat punch", "quartic": "quartic tip", "power": "power-law tip", "profile": "tip of measured profile"}
_SEGMENTS = {
    "active": "all samples in contact", "contact": "all samples in contact", "all": "all samples",
    "load": "the loading part", "unload": "the unloading part", "hold": "the hold",
}  # fmt: skip
_TARES = {
    "free-air": "The force was zeroed in air before contact",
    "none": "The force was used as recorded, without a correction of its zero",
    "calibrated": "The force was zeroed by the offset of the calibration",
}
_LIBRARIES = {"python": "Python", "casadi": "CasADi", "numpy": "NumPy", "scipy": "SciPy"}
_SOURCES = {
    "estimator": "the scatter of the residuals",
    "timing": "the uncertainty of the delay between force and position",
    "tare": "that of the zero of the force",
    "mass": "that of the mass behind the sensor",
    "radius": "that of the tip's radius",
    "poisson": "that of Poisson's ratio",
    "height": "that of the specimen's thickness",
    "beam": "that of the stiffness of the beam",
}
_NEGLIGIBLE = 0.05  # of a combined uncertainty
_SMALL = 0.001  # p-value below which only that is said


def methods_text(facts: FolderFacts, by: str | None = None, unit: str | None = None) -> CitedText:
    """Methods, and with groups their results; raises UserError where settings or columns cannot be read."""
    pipeline = facts.pipelines[0]
    model = pipeline.tracks[0].model
    comparisons = {name: compare_rows(facts.rows, name, by, unit) for name in facts.values} if by else {}
    sentences = [
        *_measurement(facts, model, pipeline), *_force(pipeline.alignment), *_model(facts, model, pipeline),
        *_fit(pipeline), *_exclusions(facts), *_assumptions(facts), *_uncertainty(facts),
        *_tests(comparisons), *_software(facts),
    ]  # fmt: skip
    paragraphs = {"Methods": " ".join(sentences)}
    if comparisons:
        paragraphs["Results"] = " ".join(_results(facts, comparisons, by or ""))
    return CitedText(paragraphs)


def _measurement(facts: FolderFacts, model: ContactModel, pipeline: Pipeline) -> Iterator[str]:
    stated = facts.instrument
    with_instrument = printable(stated) if stated else UNSTATED
    count = len(facts.rows)
    yield f"A total of {count} force-depth {_curves(count)} {_were(count)} recorded with {with_instrument}."
    tip = getattr(model, "indenter", None)
    if isinstance(tip, Indenter):
        name = pipeline.registry.name_of(type(tip))
        words = _TIPS.get(name, name.replace("-", " "))
        sizes = [f"a {' '.join(path).replace('_', ' ')} of {_size(v, u)}" for path, v, u in numbers_of(tip)]
        doubt = _std(pipeline, "radius", "m")
        yield f"The tip was {_article(words)} {words}{f' with {_joined(sizes)}' if sizes else ''}{doubt}."
    different = len({(p.tracks[0].model, p.alignment.model_dump_json()) for p in facts.pipelines}) > 1
    if different:
        yield f"The curves are in {len(facts.pipelines)} file formats; what follows is of most of them."


def _std(pipeline: Pipeline, key: str, unit: str) -> str:
    """The standard uncertainty that is stated of a number of the model or its tip, in brackets."""
    stated = pipeline.run.uncertainties.get(key)
    return "" if stated is None else f" (standard uncertainty {_size(to_si(stated, unit), unit)})"


def _size(value: float, unit: str) -> str:
    return quantity_text(value, unit).replace(" um", " µm")


def _force(alignment: AlignmentSettings) -> Iterator[str]:
    tare, std = alignment.tare, alignment.timing_uncertainty
    if isinstance(tare, str):
        zero = _TARES[tare]
    else:
        zero = f"The zero of the force was {tare:g} N" if tare else "The force was zeroed before contact"
    late = alignment.force.delay - alignment.position.delay
    if std is None:
        timing = "force and position were assumed to be simultaneous"
    elif late:
        timing = f"a delay of the force of {_ms(late)} (standard uncertainty {_ms(std)}) was corrected"
    else:
        timing = f"force and position were taken as simultaneous, with a standard uncertainty of {_ms(std)}"
    yield f"{zero}; {timing}."
    if alignment.tip_mass:
        yield f"The inertia of the {1e3 * alignment.tip_mass:g} g behind the force sensor was subtracted."
    elif alignment.tip_mass is None:
        yield "The inertia of what hangs behind the force sensor was neglected."
    if alignment.series_stiffness is not None:
        yield f"The compliance of the rig ({alignment.series_stiffness:g} N/m) was corrected."


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms"


def _model(facts: FolderFacts, model: ContactModel, pipeline: Pipeline) -> Iterator[str]:
    name = pipeline.registry.name_of(type(model))
    words = _MODELS.get(name, f"the contact model '{name.replace('-', ' ')}'")
    sources = sources_of(type(model))
    keys = keys_of(sources)
    stated = f" ({sources.removesuffix('.')})" if sources and not keys else ""
    nu = getattr(model, "poisson", None)
    poisson = f", with a Poisson's ratio of {nu:g}{_std(pipeline, 'poisson', '1')}" if isinstance(nu, float) else ""
    verb = "was" if len(facts.values) == 1 else "were"
    values = _joined([*map(readable, facts.values)]).capitalize()
    yield f"{values} {verb} estimated by {words}{stated}{cite(keys)}{poisson}."
    if "thickness" in type(model).model_fields:
        layer = getattr(model, "thickness", None)
        height = getattr(layer, "height", None)
        if height is not None:
            law = str(getattr(layer, "law", ""))
            keys = keys_of(law)
            by = f"the law '{law}'" if not keys else f"the law of {law.capitalize()} et al.{cite(keys)}"
            yield f"The finite thickness of the specimens, {_size(height, 'm')}, was corrected by {by}."
        else:
            yield "The specimens were treated as a half-space, without a correction of their thickness."


def _fit(pipeline: Pipeline) -> Iterator[str]:
    estimator = pipeline.tracks[0].estimator
    name = pipeline.registry.name_of(type(estimator))
    segment = getattr(estimator, "segment", None)
    if segment is None:
        yield f"Each curve was fitted by itself by the estimator '{name}'{cite(keys_of(sources_of(type(estimator))))}."
        return
    part = _SEGMENTS.get(segment, f"the segment '{segment}'")
    loss = getattr(estimator, "loss", "linear")
    robust = "" if loss == "linear" else f" with the robust loss '{loss}'"
    free = (
        ", with the height of the surface as a further unknown"
        if getattr(estimator, "contact_point", "") == "free"
        else ""
    )
    yield f"Each curve was fitted by itself to {part} by nonlinear least squares{robust}{free}."


def _exclusions(facts: FolderFacts) -> Iterator[str]:
    every, used = len(facts.rows), len(facts.used)
    if every == used:
        yield f"All {every} {_curves(every)} were used."
    else:
        why = [f"{printable(reason)}, n = {count}" for reason, count in facts.exclusions.items()]
        left = every - used
        yield (
            f"Of the {every} {_curves(every)}, {used} {_were(used)} used and {left} {_were(left)} excluded "
            f"({'; '.join(why)})."
        )
    doubtful = [row for row in facts.used if row.verdict == "doubtful"]
    if doubtful:
        codes = Counter(code for row in doubtful for code in row.flags)
        told = ", ".join(f"{code}: {count}" for code, count in codes.most_common())
        yield f"{len(doubtful)} of those used {'is' if len(doubtful) == 1 else 'are'} doubtful ({told})."
    for name in facts.values:
        if lost := sum(has_no_number(row.verdict_of(name)) for row in facts.used):
            yield f"{readable(name).capitalize()} could not be determined from {lost} of them."
    if facts.own_settings:
        yield f"{facts.own_settings} {_curves(facts.own_settings)} had settings of their own."


def _assumptions(facts: FolderFacts) -> Iterator[str]:
    told = [
        sentence if count == len(facts.used) else f"{sentence} (of {count} curves)"
        for sentence, count in facts.conditions.values()
    ]
    if told:
        were = "was" if len(told) == 1 else "were"
        yield f"The following {were} assumed, not measured: {'; '.join(map(printable, told))}."


def _uncertainty(facts: FolderFacts) -> Iterator[str]:
    known = {name: found for name in facts.values if (found := facts.relative_uncertainty(name)) is not None}
    if not known:
        return
    sources = _sources(facts)
    of = f", which comprise {_joined(sources)}" if sources else ""
    yield f"Single values carry combined standard uncertainties (coverage factor 1){cite(keys_of('uncertainty'))}{of}."
    whole = [f"{100 * found[0]:.2g} % for {readable(name)}" for name, found in known.items()]
    shared = [f"{100 * found[1]:.2g} %" for found in known.values()]
    yield (
        f"The median relative uncertainty was {_joined(whole)}; the part that all curves share, which averaging does "
        f"not reduce, was {_joined(shared)}."
    )


def _sources(facts: FolderFacts) -> list[str]:
    """What the budget of a typical curve names, but for what moves no value; nothing where it cannot be fitted here."""
    row = facts.typical(facts.values[0])
    try:
        outcome = outcome_of(facts.folder, row.curve) if row is not None else None
    except PalpateError:
        return []
    if outcome is None or row is None:
        return []
    found = outcome.result.tracks[row.track]
    moving = [
        one.source.removesuffix(" (not declared)")
        for one in found.budget
        if any(
            (effect.contribution or 0.0) > _NEGLIGIBLE * value.combined
            for name, effect in one.effects.items()
            if (value := found.parameters.get(name)) is not None
        )
    ]
    return [_SOURCES.get(source, f"that of {source.replace('-', ' ')}") for source in moving]


def _tests(comparisons: Mapping[str, GroupComparison]) -> Iterator[str]:
    first = next(iter(comparisons.values()), None)
    if first is None or len(first.groups) < 2:
        return
    keys = keys_of(first.sentence)
    yield f"{first.sentence.removesuffix('.')}{cite(keys)}."


def _software(facts: FolderFacts) -> Iterator[str]:
    known = facts.provenance
    versions = list(dict.fromkeys(one.versions.get("palpate", "?") for one in known))
    if not known:
        yield "The version of palpate by which the fits were made is not on record."
        return
    others = [f"{word} {known[-1].versions[key]}" for key, word in _LIBRARIES.items() if key in known[-1].versions]
    yield f"Fits were made with palpate {_joined(versions)} ({', '.join(others)}){cite(keys_of('casadi'))}."


def _results(facts: FolderFacts, comparisons: Mapping[str, GroupComparison], by: str) -> Iterator[str]:
    first = next(iter(comparisons.values()))
    of = "single curves" if first.singles else f"the means of n units ({first.unit})"
    yield f"Values are means ± standard deviations of {of}, by {by}."
    for name, found in comparisons.items():
        word, factor = display_unit(facts.folder.units.get(name, "1"))
        groups = [
            f"{value_with_uncertainty(factor * group.mean, factor * group.std)} {word} in {printable(group.name)} "
            f"(n = {group.units}{'' if found.singles else f', {group.curves} curves'})"
            for group in found.groups
        ]
        yield f"{readable(name).capitalize()} was {_joined(groups)}."
        if found.untested:
            yield f"There is {found.untested}."
        for pair in found.most_significant():
            if math.isnan(pair.p):
                continue
            p = pair.corrected if found.tests > 1 else pair.p
            low, high = (f"{factor * edge:.3g}" for edge in (pair.low, pair.high))
            yield (
                f"The difference {printable(pair.difference_is)} was {factor * pair.difference:.3g} {word} "
                f"(95 % confidence interval {low} to {high} {word}; t({pair.freedom:.3g}) = {pair.t:.3g}, "
                f"{'corrected ' if found.tests > 1 else ''}{_p(p)})."
            )


def _p(p: float) -> str:
    return f"p < {_SMALL}" if p < _SMALL else f"p = {p:.2g}"


def _article(word: str) -> str:
    return "an" if word[:1] in "aeiou" else "a"


def _curves(count: int) -> str:
    return "curve" if count == 1 else "curves"


def _were(count: int) -> str:
    return "was" if count == 1 else "were"


def _joined(words: list[str]) -> str:
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]])) if words else ""
