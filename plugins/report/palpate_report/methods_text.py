"""The methods section of a folder of fits: measurement, fit, judgement and comparison of its curves."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

from palpate import Indenter, PalpateError, printable, to_si
from palpate_engine import Pipeline, display_unit, needs_fact, numbers_of
from palpate_kit.curves.replication_unit import compare_rows
from palpate_kit.numerics.group_comparison import GroupComparison, PairTest
from palpate_kit.numerics.unit_group import UnitGroup
from palpate_kit.terminal.phrase import Phrase, Quantity, curve_count, merged_phrases, phrase_text, quantity_text
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
    "curvature_radius": "that of the tip's radius of curvature",
    "poisson": "that of Poisson's ratio",
    "height": "that of the specimen's thickness",
    "thickness": "the spread between the laws of a layer",
    "beam": "that of the stiffness of the beam",
}
_MIN_SHARE = 0.05  # of a combined uncertainty, that a source is named from: a choice
_MIN_SHOWN_P = 0.001  # p-value below which only that is said: the custom of journals


def methods_text(facts: FolderFacts, by: str | None = None, unit: str | None = None) -> CitedText:
    """Methods, and with groups their results; raises UserError where settings or columns cannot be read."""
    comparisons = {name: compare_rows(facts.rows, name, by, unit) for name in facts.values} if by else {}
    sentences = [
        _records(facts), *_settings_of_curves(facts), *_exclusions(facts), *_assumptions(facts), *_uncertainty(facts),
        *_tests(comparisons), *_software(facts),
    ]  # fmt: skip
    paragraphs = {"Methods": " ".join(sentences)}
    if comparisons:
        paragraphs["Results"] = " ".join(_results(facts, comparisons, by or ""))
    return CitedText(paragraphs)


def _records(facts: FolderFacts) -> str:
    stated = facts.instrument
    with_instrument = printable(stated) if stated else UNSTATED
    count = len(facts.rows)
    return f"A total of {count} force-depth {_curves(count)} {_were(count)} recorded with {with_instrument}."


def _settings_of_curves(facts: FolderFacts) -> Iterator[str]:
    """Return a sentence on each setting of the curves, and where they differ in words on each kind of them."""
    subjects = (_tip, _zero, _inertia, _beam, _mount, partial(_model, facts.values), _thickness, _inclination, _fit)
    for phrase_of in subjects:
        kinds = merged_phrases((phrase_of(pipeline), count) for pipeline, count in facts.pipelines)
        for phrases, count in kinds:
            if text := phrase_text(phrases, _size):
                yield f"{text}." if len(kinds) == 1 else f"{text} ({curve_count(count)})."


def _size(quantity: Quantity) -> str:
    return quantity_text(quantity).replace(" um", " µm")


def _std(pipeline: Pipeline, key: str, unit: str) -> Phrase:
    """Return the standard uncertainty that is stated of a number of the model or its tip, in brackets."""
    stated = pipeline.run.uncertainties.get(key)
    return _in_brackets(None if stated is None else to_si(stated, unit), unit)


def _in_brackets(std: float | None, unit: str) -> Phrase:
    return () if std is None else (" (standard uncertainty ", Quantity(std, unit), ")")


def _tip(pipeline: Pipeline) -> Phrase:
    """Return the sentence on the tip and its sizes, with the uncertainty of its radius; empty without a tip."""
    tip = getattr(pipeline.tracks[0].model, "indenter", None)
    if not isinstance(tip, Indenter):
        return ()
    name = pipeline.registry.name_of(type(tip))
    tip_words = _TIPS.get(name, name.replace("-", " "))
    sizes: list[Phrase] = []
    for path, value, unit in numbers_of(tip):
        sizes.append((f"a {' '.join(path).replace('_', ' ')} of ", Quantity(value, unit)))
    doubt = _std(pipeline, "radius", "m") or _std(pipeline, "curvature_radius", "m")
    separators = [" with ", *[", "] * (len(sizes) - 2), " and "]
    parts = (part for separator, size in zip(separators, sizes, strict=False) for part in (separator, *size))
    return (f"The tip was {_article(tip_words)} {tip_words}", *parts, *doubt)


def _zero(pipeline: Pipeline) -> Phrase:
    """Return the sentence on the zero of the force, and on the delay between force and position.

    A phrase is a tuple of texts and quantities.
    """
    alignment = pipeline.alignment
    tare, std = alignment.tare, alignment.timing_uncertainty
    zero: Phrase
    if isinstance(tare, str):
        zero = (_TARES[tare],)
    elif tare or alignment.zero_uncertainty:
        doubt = _in_brackets(alignment.zero_uncertainty or None, "N")
        zero = ("The zero of the force was ", Quantity(tare, "N"), *doubt)
    else:
        zero = ("The force was zeroed before contact",)
    late = Quantity(alignment.force.delay - alignment.position.delay, "s", digits=3)
    if std is None:
        return (*zero, "; force and position were assumed to be simultaneous")
    if late.value:
        delayed = ("; a delay of the force of ", late, " (standard uncertainty ", Quantity(std, "s", digits=3))
        return (*zero, *delayed, ") was corrected")
    simultaneous = "; force and position were taken as simultaneous, with a standard uncertainty of "
    return (*zero, simultaneous, Quantity(std, "s", digits=3))


def _inertia(pipeline: Pipeline) -> Phrase:
    mass = pipeline.alignment.tip_mass
    if mass is None:
        return ("The inertia of what hangs behind the force sensor was neglected",)
    if not mass:
        return ()
    std = _in_brackets(pipeline.alignment.tip_mass_uncertainty, "kg")
    return ("The inertia of the ", Quantity(mass, "kg"), " behind the force sensor", *std, " was subtracted")


def _beam(pipeline: Pipeline) -> Phrase:
    beam, std = pipeline.alignment.beam, pipeline.alignment.beam_uncertainty
    if beam is None:
        return ()
    stiffness = (Quantity(beam, "N/m"), *_in_brackets(std, "N/m"))
    return ("The position was that of a stage; the deflection of the beam of ", *stiffness, " on it was subtracted")


def _mount(pipeline: Pipeline) -> Phrase:
    stiffness = pipeline.alignment.series_stiffness
    if stiffness is None:
        return ()
    return ("The compliance of the rig (", Quantity(stiffness, "N/m"), ") was counted as an uncertainty")


def _model(values: Sequence[str], pipeline: Pipeline) -> Phrase:
    """Return the sentence on the model of the first track, by which the named values were estimated.

    Its sources are cited, or stated in brackets where the bibliography does not have them.
    """
    model = pipeline.tracks[0].model
    name = pipeline.registry.name_of(type(model))
    model_words = _MODELS.get(name, f"the contact model '{name.replace('-', ' ')}'")
    sources = sources_of(type(model))
    keys = keys_of(sources)
    stated = f" ({sources.removesuffix('.')})" if sources and not keys else ""
    nu = getattr(model, "poisson", None)
    poisson: Phrase = ()
    if isinstance(nu, float):
        poisson = (", with a Poisson's ratio of ", Quantity(nu), *_std(pipeline, "poisson", "1"))
    verb = "was" if len(values) == 1 else "were"
    subject = _joined([*map(readable, values)]).capitalize()
    head = f"{subject} {verb} estimated by {model_words}{stated}{cite(keys)}"
    return (head, *poisson)


def _thickness(pipeline: Pipeline) -> Phrase:
    """Return the sentence on the thickness of the specimens; empty for a model that has none.

    A layer has height [m], law of the correction, and whether it is bonded to its base.
    """
    model = pipeline.tracks[0].model
    if "thickness" not in type(model).model_fields:
        return ()
    layer = getattr(model, "thickness", None)
    if getattr(layer, "height", None) is None:
        return ("The specimens were treated as a half-space, without a correction of their thickness",)
    law = str(getattr(layer, "law", ""))
    keys = keys_of(law)
    law_text = f"the law of {law.capitalize()} et al.{cite(keys)}" if keys else f"the law '{law}'"
    height: float = getattr(layer, "height", 0.0)
    size = (", ", Quantity(height, "m"), *_std(pipeline, "height", "m"), ",") if height else ()  # a table has its own
    bonded = getattr(layer, "bonded", None)
    base = "" if bonded is None else " glued to their base" if bonded else " sliding on their base"
    return (f"The finite thickness of the specimens{base}", *size, f" was corrected by {law_text}")


def _inclination(pipeline: Pipeline) -> Phrase:
    angle = getattr(getattr(pipeline.tracks[0].model, "skin", None), "inclination", 0.0)
    return ("The skin under the tip was inclined by ", Quantity(angle, "rad")) if angle else ()


def _fit(pipeline: Pipeline) -> Phrase:
    """Return the sentence on the estimator of the first track: the segment of a curve that it fits, its loss."""
    estimator = pipeline.tracks[0].estimator
    name = pipeline.registry.name_of(type(estimator))
    segment = getattr(estimator, "segment", None)
    if segment is None:
        cited = cite(keys_of(sources_of(type(estimator))))
        return (f"Each curve was fitted by itself by the estimator '{name}'{cited}",)
    part = _SEGMENTS.get(segment, f"the segment '{segment}'")
    loss = getattr(estimator, "loss", "linear")
    robust = "" if loss == "linear" else f" with the robust loss '{loss}'"
    is_free = getattr(estimator, "contact_point", "") == "free"
    free = ", with the height of the surface as a further unknown" if is_free else ""
    return (f"Each curve was fitted by itself to {part} by nonlinear least squares{robust}{free}",)


def _exclusions(facts: FolderFacts) -> Iterator[str]:
    """Yield sentences on the curves that were used and excluded, their verdicts, open facts and own settings."""
    total, used_count = len(facts.rows), len(facts.used)
    if total == used_count:
        yield f"All {total} {_curves(total)} were used."
    else:
        reasons = [f"{printable(reason)}, n = {count}" for reason, count in facts.exclusions.items()]
        excluded_count = total - used_count
        yield (
            f"Of the {total} {_curves(total)}, {used_count} {_were(used_count)} used and "
            f"{excluded_count} {_were(excluded_count)} excluded ({'; '.join(reasons)})."
        )
    yield from _verdicts(facts)
    for name in facts.values:
        if open_count := sum(needs_fact(row.verdict_of(name)) for row in facts.used):
            subject = f"{readable(name).capitalize()} of {open_count} of them"
            yield f"{subject} needs a fact that was not stated, and is left out."
    if facts.own_settings:
        yield f"{facts.own_settings} {_curves(facts.own_settings)} had settings of their own."


def _verdicts(facts: FolderFacts) -> Iterator[str]:
    """Yield sentences on the verdicts of each value that is not good in all curves, and on shared findings.

    `facts` have the rows of a folder of fits, as a table of results.
    """
    table = facts.table  # of results, a row for each curve that is used
    for name in table.names:
        verdicts = Counter(
            value.word for row in table.rows if (value := row.values.get(name)) is not None and value.word
        )
        counts = [f"{word} in {count}" for word, count in verdicts.most_common() if not word.startswith("needs ")]
        if verdicts.keys() - {"good"} and counts:
            yield f"{readable(name).capitalize()} was {_joined(counts)}."
    for finding, rows, _ in table.shared_findings():
        if finding.word == "doubtful":
            cause = ": ".join((finding.code, *finding.suspects[:1]))
            sign = finding.sentence.partition("; ")[0]
            yield f"In {len(rows)} {_curves(len(rows))}, {printable(sign)} ({printable(cause)})."


def _assumptions(facts: FolderFacts) -> Iterator[str]:
    sentences = [
        sentence if count == len(facts.used) else f"{sentence} (of {count} curves)"
        for sentence, count in facts.conditions.values()
    ]
    if sentences:
        were = "was" if len(sentences) == 1 else "were"
        yield f"The following {were} assumed, not measured: {'; '.join(map(printable, sentences))}."


def _uncertainty(facts: FolderFacts) -> Iterator[str]:
    """Yield sentences on the combined uncertainties: their sources, and medians relative to the values."""
    # By value the shares of it: combined, and what all curves have in common.
    uncertainties = {name: shares for name in facts.values if (shares := facts.relative_uncertainty(name)) is not None}
    if not uncertainties:
        return
    sources = _sources(facts)
    parts = f", which comprise {_joined(sources)}" if sources else ""
    citation = cite(keys_of("uncertainty"))
    yield f"Single values carry combined standard uncertainties (coverage factor 1){citation}{parts}."
    whole = [f"{_percent(shares[0])} for {readable(name)}" for name, shares in uncertainties.items()]
    shared = [_percent(shares[1]) for shares in uncertainties.values()]
    yield (
        f"The median relative uncertainty was {_joined(whole)}; the part that all curves share, which averaging does "
        f"not reduce, was {_joined(shared)}."
    )


def _percent(share: float) -> str:
    """Return a share in per cent, to two digits."""
    return f"{float(f'{100 * share:.2g}'):g} %"


def _sources(facts: FolderFacts) -> list[str]:
    """Return the sources of uncertainty, in words, that contribute to a value of a typical curve.

    `facts` have the rows of a folder of fits, one of which is typical. Empty where that curve cannot be fitted here.
    """
    row = facts.typical(facts.values[0])
    try:
        outcome = outcome_of(facts.folder, row.curve) if row is not None else None
    except PalpateError:
        return []
    if outcome is None or row is None:
        return []
    track = outcome.result.tracks[row.track]
    moving: list[str] = []
    for entry in track.budget:
        values = [(effect, track.parameters.get(name)) for name, effect in entry.effects.items()]
        if any(value and (effect.contribution or 0.0) > _MIN_SHARE * value.combined for effect, value in values):
            moving.append(entry.source.removesuffix(" (not declared)"))
    return [_SOURCES.get(source, f"that of {source.replace('-', ' ')}") for source in moving]


def _tests(comparisons: Mapping[str, GroupComparison]) -> Iterator[str]:
    first = next(iter(comparisons.values()), None)
    if first is None or len(first.groups) < 2:
        return
    keys = keys_of(first.sentence)
    yield f"{first.sentence.removesuffix('.')}{cite(keys)}."


def _software(facts: FolderFacts) -> Iterator[str]:
    provenance = facts.provenance
    versions = list(dict.fromkeys(entry.versions.get("palpate", "?") for entry in provenance))
    if not provenance:
        yield "The version of palpate by which the fits were made is not on record."
        return
    libraries = [
        f"{word} {provenance[-1].versions[key]}" for key, word in _LIBRARIES.items() if key in provenance[-1].versions
    ]
    yield f"Fits were made with palpate {_joined(versions)} ({', '.join(libraries)}){cite(keys_of('casadi'))}."


def _results(facts: FolderFacts, comparisons: Mapping[str, GroupComparison], by: str) -> Iterator[str]:
    """Yield the sentences on the results: means of the groups, and their significant differences, by parameter."""
    first = next(iter(comparisons.values()))
    members = "single curves" if first.singles else f"the means of n units ({first.unit})"
    yield f"Values are means ± standard deviations of {members}, by {by}."
    for name, comparison in comparisons.items():
        symbol, factor = display_unit(facts.folder.units.get(name, "1"))
        groups = [_group_text(group, symbol, factor, comparison.singles) for group in comparison.groups]
        yield f"{readable(name).capitalize()} was {_joined(groups)}."
        if comparison.untested:
            yield f"There is {comparison.untested}."
        for pair in comparison.most_significant():
            if not math.isnan(pair.p):
                yield _difference_text(pair, symbol, factor, is_corrected=comparison.tests > 1)


def _group_text(group: UnitGroup, symbol: str, factor: float, is_of_singles: bool) -> str:
    """Return mean and standard deviation of a group with its name and numbers; `factor` turns SI into the unit."""
    spread = value_with_uncertainty(factor * group.mean, factor * group.std)
    curves = "" if is_of_singles else f", {group.curves} curves"
    return f"{spread} {symbol} in {printable(group.name)} (n = {group.units}{curves})"


def _difference_text(pair: PairTest, symbol: str, factor: float, is_corrected: bool) -> str:
    """Return the sentence on a difference: its interval, t and p, which is corrected for several tests."""
    low, high = (f"{factor * bound:.3g}" for bound in (pair.low, pair.high))
    p_text = f"corrected {_p(pair.corrected)}" if is_corrected else _p(pair.p)
    return (
        f"The difference {printable(pair.difference_is)} was {factor * pair.difference:.3g} {symbol} "
        f"(95 % confidence interval {low} to {high} {symbol}; t({pair.freedom:.3g}) = {pair.t:.3g}, {p_text})."
    )


def _p(p: float) -> str:
    return f"p < {_MIN_SHOWN_P}" if p < _MIN_SHOWN_P else f"p = {p:.2g}"


def _article(noun: str) -> str:
    return "an" if noun[:1] in "aeiou" else "a"


def _curves(count: int) -> str:
    return "curve" if count == 1 else "curves"


def _were(count: int) -> str:
    return "was" if count == 1 else "were"


def _joined(texts: list[str]) -> str:
    return " and ".join(filter(None, [", ".join(texts[:-1]), texts[-1]])) if texts else ""
