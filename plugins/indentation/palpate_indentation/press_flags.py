"""The flags of a press."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from palpate import BudgetRow, Flag

from palpate_indentation.baseline import BaselineFit, force_of
from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.press import Branch
from palpate_indentation.retract_theories import PullOff

# Choices (docs/indentation.md).
_CHANGE_SIGMAS = 3.0  # standard uncertainties of a change over depth that is flagged
_MATERIAL_SHARE = 0.05  # of the modulus: a smaller effect is not flagged
_MAX_TILT_FORCE = 0.5  # of the press's force, that a tilt makes over its depth


def contributions(law: ElasticLaw, budget: Sequence[BudgetRow]) -> list[float]:
    """Return the contribution of every row to the uncertainty of the modulus [unit of the modulus]."""
    return [row.effects[law.name].contribution or 0.0 for row in budget]


def press_flags(
    law: ElasticLaw,
    branch: Branch,
    baseline_fit: BaselineFit,
    budget: Sequence[BudgetRow],
    rise: tuple[float, float],
    pull: PullOff | None,
) -> Iterator[Flag]:
    """Yield the flags of a press by its budget, its rise of the modulus over depth with uncertainty, and its pull."""
    modulus = baseline_fit.fit.modulus
    change, change_std = rise
    # Beyond 3 standard uncertainties and 5 %.
    if abs(change) > max(_CHANGE_SIGMAS * change_std, _MATERIAL_SHARE):
        text = (
            f"the modulus changes by {change:+.0%} +- {change_std:.1%} "
            "from the shallower half of the depth to the deeper"
        )
        # From the middle of the depth to either end it is half of the change.
        yield Flag("modulus-over-depth", text, effects={law.name: 0.5 * abs(change) * modulus})

    shares = dict(zip((row.source for row in budget), contributions(law, budget), strict=True))
    by_viscosity = shares.pop("viscosity", 0.0)
    by_others = float(np.linalg.norm(list(shares.values())))
    if by_viscosity > max(by_others, _MATERIAL_SHARE * modulus):
        text = (
            f"what is not known of the viscosity moves the modulus by {by_viscosity / modulus:.0%}, more than all else"
        )
        yield Flag("viscosity-unclear", text, effects={law.name: by_viscosity}, causes=("viscosity",))
    if pull is not None:
        yield Flag("adhesion", f"the material pulls with {pull.force:.3g} +- {pull.std:.2g} N")
    yield from _baseline_flags(law, branch, baseline_fit)


def _baseline_flags(law: ElasticLaw, branch: Branch, baseline_fit: BaselineFit) -> Iterator[Flag]:
    """Yield a flag for a tilt that the air does not determine, or that makes most of the force."""
    fit, undetermined, by_tilt = baseline_fit.fit, baseline_fit.undetermined, baseline_fit.by_tilt
    if undetermined is not None and by_tilt > _MATERIAL_SHARE * fit.modulus:
        text = (
            f"the air does not show the tilt ({undetermined.tilt:+.3g} +- {undetermined.tilt_std:.2g} N/m by least "
            f"squares): held at zero, which counts {by_tilt / fit.modulus:.0%} in the uncertainty of the modulus"
        )
        yield Flag("baseline-unclear", text, effects={law.name: by_tilt}, causes=("tilt",))
        return
    depth = float(fit.surface - branch.height.min())
    tilt_share = abs(fit.tilt) * depth / force_of(law, branch, fit)
    if tilt_share > _MAX_TILT_FORCE:
        yield Flag(
            "baseline-unclear", f"the tilt of the baseline makes {tilt_share:.0%} of the press's force over its depth"
        )
