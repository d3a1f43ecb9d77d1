"""Model discrepancy: the uncertainty of every value by a law that does not describe a record to its noise.

A misfit is *visible*: its mean square s^2 in contact is what the residual has beyond the noise. A part of it that lies
along the derivatives of the force by the fitted parameters is taken by them, and is hidden. With a misfit that is
spread evenly over m patterns, a direction of the parameters hides as much of it as any other:

    C = s^2 (n / m) (J^T J)^-1

J (n, f) are the derivatives by what was fitted, the surface and a fitted zero included.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from palpate import ContactModel, Diagnosed, Flag, Floats, Parameter
from palpate_kit.numerics.normal_equations import standard_errors

from palpate_uncertainty.causes import cause_label, cause_of, cause_words, sign_of

# Choices. The patterns m that a misfit is spread over were chosen on point palpations of one silicone by two tips: E
# and eta of both agree within the uncertainty that follows. 2 and 8 give the same verdicts.
PATTERNS = 4.0  # independent patterns of a misfit, by the root of whose number its effect on a value is divided
VISCOUS_PATTERNS = 2.0  # a viscosity follows slow patterns of the loading alone
RIVAL_EVIDENCE = 0.7  # of the evidence of a cause of the rig, below which no cause of the material rivals it
SEVERAL_NUMBERS = 0.7  # of a gain by several numbers, which follow a pattern that is not theirs as well
LEAST_SHARE = 0.1  # of the visible pattern, that a cause of the rig explains at least
NO_FIT = 0.3  # of the force's own variation in contact, above which a misfit is not one of the law any more
FARTHEST = 10.0  # times its typical size, from which on an alternative explains nothing
_CHECK_READING = "Check sign, column and unit of force and height, then tip and law (`palpate fit choose --help`)."
NEARLY = 0.7  # of what the best alternative explains, from which on a second one is named
_SHOWN_P = 1e-99  # that a number of two digits in its exponent can state
_SMALLEST_CHI_SQUARE = 1e-300  # in a quotient, in place of 0: near the smallest double


@dataclass(frozen=True)
class Explanation:
    """A residual along the derivatives of one alternative."""

    gain: float  # chi square, and twice the logarithm of the ratio of likelihoods
    numbers: int  # that the alternative adds to the model
    p: float
    samples: int
    shifts: Floats = field(default_factory=lambda: np.zeros(0))  # (k,) [SI] of the parameters, of one step to it
    times: float = 0.0  # a typical size, that the step is
    power: float = 0.0  # [N^2] mean square in contact along it, less what chance has there

    @property
    def evidence(self) -> float:
        """The gain less what numbers of no use would gain (Schwarz 1978)."""
        gain = self.gain if self.numbers <= 1 else SEVERAL_NUMBERS * self.gain
        return gain - self.numbers * math.log(max(self.samples, 1))


@dataclass(frozen=True)
class Misfit:
    """A residual that is not the noise of a right model."""

    p: float
    excess: float  # [N^2] mean square in contact beyond the noise
    variation: float  # [N] standard deviation of the force in contact
    pattern: float  # chi square of what is visible of it, by any test
    jacobian: Floats  # (n, k + 1) [N/SI] derivatives of the force in contact by the parameters and the surface
    is_fitted: Sequence[bool]  # (k + 1,) of these, False for what is fixed
    explanations: Mapping[str, Explanation]  # by cause, those that are significant

    @property
    def is_of_the_law(self) -> bool:
        """Return False for a residual that is as large as the force's own course: nothing was fitted."""
        return math.sqrt(self.excess) <= NO_FIT * self.variation

    @property
    def causes(self) -> list[str]:
        """The alternative of the most evidence, and the second one where it explains nearly as much."""
        ranked = sorted(self.explanations, key=lambda name: -self.explanations[name].evidence)
        return [name for name in ranked if self.explanations[name].gain >= NEARLY * self.explanations[ranked[0]].gain][
            :2
        ]

    @property
    def wrong_facts(self) -> list[str]:
        """The causes of the rig that explain the residual about equally well, if none of the material rivals them."""
        evidence = {name: explanation.evidence for name, explanation in self.explanations.items()}
        of_rig = sorted((name for name in evidence if cause_of(name).of_rig), key=lambda name: -evidence[name])
        if not of_rig:
            return []
        best = of_rig[0]
        rival = max((evidence[name] for name in evidence if not cause_of(name).of_rig), default=0.0)
        explains = self.explanations[best].gain > LEAST_SHARE * self.pattern
        if not explains or max(rival, 0.0) >= RIVAL_EVIDENCE * evidence[best]:
            return []
        return [name for name in of_rig if evidence[name] >= NEARLY * evidence[best]]

    def uncertainty(self, parameters: Sequence[Parameter]) -> Floats:
        """Return the uncertainties (k + 1,) [SI] of parameters and surface by the misfit, 0 for what is fixed."""
        fitted = np.asarray(self.is_fitted)
        unit = np.zeros(len(fitted))
        unit[fitted] = spread_of(self.jacobian[:, fitted])
        patterns = [VISCOUS_PATTERNS if parameter.role == "viscous" else PATTERNS for parameter in parameters]
        return np.asarray(math.sqrt(self.excess) * unit / np.sqrt([*patterns, PATTERNS]))


def spread_of(jacobian: Floats) -> Floats:
    """Return the uncertainties (f,) by a misfit of 1 N^2 in one pattern: sqrt(diag(n (J^T J)^-1)), J (n, f)."""
    return standard_errors(jacobian) * math.sqrt(len(jacobian))


def judge_misfit(
    misfit: Misfit, parameters: Sequence[Parameter], table: Mapping[str, Any], remark: str, is_layer: bool = False
) -> Diagnosed:
    """Return the row of the budget that a misfit adds, with its note or its finding; `remark` ends the sentence.

    A misfit of the material is a note: the row holds its effect. A fact of the rig that explains it better is a
    finding, if that moves a value beyond its uncertainty, this row included. `is_layer` states that the model has a
    layer of a stated height.
    """
    # Standard uncertainties by the misfit: of the parameters, in their order, and of the surface [m].
    names = [parameter.name for parameter in parameters]
    *uncertainties, surface = misfit.uncertainty(parameters).tolist()
    row = dict(zip(names, uncertainties, strict=True))
    if not misfit.is_of_the_law:  # a residual as large as the force itself
        flags = [_no_law(misfit, names)]
    elif misfit.wrong_facts:
        shifts = np.max([np.abs(misfit.explanations[fact].shifts) for fact in misfit.wrong_facts], axis=0)
        flags = [_wrong_fact(misfit, is_layer, dict(zip(names, shifts.tolist(), strict=True)), remark)]
    else:
        flags = _of_the_material(misfit, parameters, row, remark)
    table = dict(table) | {
        "reasons": misfit.causes,
        "wrong_facts": misfit.wrong_facts,
        "discrepancy": math.sqrt(misfit.excess),
    }
    if misfit.causes and not misfit.wrong_facts and (laws := cause_of(misfit.causes[0]).laws):
        table["better_laws"] = laws
    return Diagnosed(tuple(flags), row, table=table, surface=surface)


def _no_law(misfit: Misfit, names: Sequence[str]) -> Flag:
    """Return the finding that a law describes so little of a record that none of its values counts."""
    percent = 100.0 * math.sqrt(misfit.excess) / misfit.variation
    text = f"the law does not describe the record: {percent:.0f} % of the force's variation remain"
    return Flag("lack-of-fit", text, effects=dict.fromkeys(names, math.inf), causes=(), remedy=_CHECK_READING)


def _of_the_material(
    misfit: Misfit, parameters: Sequence[Parameter], row: Mapping[str, float], remark: str
) -> list[Flag]:
    """Return the note on a misfit of the material, and a finding if its likeliest cause acts as a viscosity does.

    `row` has the standard uncertainty by the misfit, by parameter; `remark` ends the note.
    """
    level = f"p {misfit.p:.0e}" if misfit.p > _SHOWN_P else "p < 1e-99"
    likely = "no alternative explains it"
    if misfit.causes:
        likely = f"likely {' or '.join(map(cause_words, misfit.causes))}"
    text = f"the residual is not the noise of the channel ({level}); {likely}{remark}"
    suspects = tuple(dict.fromkeys(map(cause_label, misfit.causes)))
    flags = [Flag("model-discrepancy", text, effects=row, suspects=suspects)]
    for name in misfit.causes[:1]:  # the likeliest, if there is one
        cause = cause_of(name)
        if cause.moves:
            viscous = [parameter.name for parameter in parameters if parameter.role == "viscous"]
            text = f"{cause_words(name)} acts with the speed as a viscosity does, so that none is bounded"
            effects = dict.fromkeys(viscous, math.inf)
            flags.append(
                Flag(
                    "lack-of-fit", text, effects=effects, causes=(), remedy=cause.remedy,
                    suspects=(cause_label(name),),
                )
            )  # fmt: skip
    return flags


def _wrong_fact(misfit: Misfit, is_layer: bool, effects: Mapping[str, float], remark: str) -> Flag:
    """Return the finding that a fact of the rig is wrong: its sign, and the share of the misfit that it explains."""
    suspects = tuple(name for name in misfit.causes if name in misfit.wrong_facts) or tuple(misfit.wrong_facts[:1])
    best = misfit.explanations[suspects[0]]
    percent = min(100.0 * best.gain / max(misfit.pattern, _SMALLEST_CHI_SQUARE), 100.0)
    sign = sign_of(suspects[0], is_layer, best.times)
    facts = " or ".join(dict.fromkeys(cause_words(name, is_layer) for name in suspects))
    text = f"{sign}; {facts} would explain {percent:.0f} % of it{remark}"
    remedy, keys = cause_of(suspects[0]).remedy, tuple(dict.fromkeys(map(cause_label, suspects)))
    return Flag("lack-of-fit", text, effects=effects, causes=(), remedy=remedy, suspects=keys)


def has_layer(model: ContactModel) -> bool:
    """Return True for a model of a layer of a stated height, and not of a half-space."""
    return getattr(model, "thickness", None) not in (None, "half-space")
