"""Values by layers other than the stated one that give the same force, as far as the statement admits them."""

from __future__ import annotations

from collections.abc import Sequence

from palpate import Indenter, Parameter

from palpate_models.thickness import Layer, Thickness, corrected_contact

USUAL_HEIGHT = 22e-3  # [m] of a specimen of which no thickness is declared: that of the paper's specimens
_MAX_STRAIN = 0.1  # depth over height to which the published corrections are derived (Dimitriadis et al. 2002)
# Finite elements on a base without friction are softer than Dimitriadis' law by this much X = a/h: 1.5, 2.8, 4.3 and
# 7 % at X = 0.1, 0.2, 0.3 and 0.5 (benchmarks/results/models.md).
_SLIDING_BASE = 0.14  # per X
_MAX_RATIO = 0.5  # X to which they are computed


def other_layers(
    parameters: Sequence[Parameter], theta: Sequence[float], indenter: Indenter, thickness: Layer, depth: float
) -> dict[str, tuple[float, ...]]:
    """Return the parameter values of the same force at a depth [m] under each other layer, by its name.

    Of a specimen without a declared thickness: a layer of 22 mm. Of a law: the other published one, a base that
    slides by finite elements, and, deeper than the tenth of the height that the laws are derived for, the one
    fitted to finite elements at large strain. An elastic parameter goes with A(d) c(d), a viscous one with its
    derivative. Empty where nothing is published for the tip.
    """
    alternatives = {}
    area, length = corrected_contact(indenter, thickness, depth)
    for name, law in _laws(indenter, thickness, depth).items():
        try:
            other_area, other_length = corrected_contact(indenter, law, depth)
        except ValueError:  # no correction is known for the tip
            continue
        ratios = {"elastic": area / other_area, "viscous": length / other_length}
        alternatives[name] = _scaled(parameters, theta, ratios)
    if isinstance(thickness, Thickness) and thickness.law == "dimitriadis" and not thickness.is_bonded:
        ratio = min(indenter.contact_radius(depth) / thickness.height, _MAX_RATIO)
        share = 1.0 / (1.0 - _SLIDING_BASE * ratio)
        alternatives["a base without friction"] = _scaled(parameters, theta, {"elastic": share, "viscous": share})
    return alternatives


def _scaled(parameters: Sequence[Parameter], theta: Sequence[float], ratios: dict[str, float]) -> tuple[float, ...]:
    """Return parameter values times the ratio of their role; those of no role stay."""
    pairs = zip(parameters, theta, strict=True)
    return tuple(value * ratios.get(parameter.role or "", 1.0) for parameter, value in pairs)


def _laws(indenter: Indenter, thickness: Layer, depth: float) -> dict[str, Thickness]:
    """Return the other corrections, which are not validated: only their factor is used."""
    if thickness is None:
        usual = Thickness.model_construct(law="garcia", height=USUAL_HEIGHT)
        return {f"a bonded layer of {1e3 * USUAL_HEIGHT:.0f} mm": usual}
    if not isinstance(thickness, Thickness) or thickness.law == "table":
        return {}
    changed = {"sticking": False, "diameter": None}
    laws = {}
    if thickness.law == "finite-cylinder":
        laws["dimitriadis"] = thickness.model_copy(update=changed | {"law": "dimitriadis"})
    elif thickness.law == "garcia":
        laws["dimitriadis"] = thickness.model_copy(update={"law": "dimitriadis"})
    elif thickness.is_bonded:
        laws["garcia"] = thickness.model_copy(update={"law": "garcia"})
    if thickness.law != "finite-cylinder" and depth > _MAX_STRAIN * thickness.height:
        laws["finite-cylinder"] = thickness.model_copy(update={"law": "finite-cylinder"})
    return laws
