"""Values by layers other than the stated one that give the same force, as far as the statement admits them."""

from __future__ import annotations

from collections.abc import Sequence

from palpate import Indenter, Parameter

from palpate_models.thickness import Layer, Thickness, corrected_contact

USUAL_HEIGHT = 22e-3  # [m] of the silicone specimens of the paper, 50 by 22 mm: where no thickness is declared
_MAX_STRAIN = 0.1  # depth over height to which the published corrections are derived (Dimitriadis et al. 2002)
# Finite elements on a base without friction are softer than Dimitriadis' law by this much X = a/h: 1.5, 2.8, 4.3 and
# 7 % at X = 0.1, 0.2, 0.3 and 0.5 (benchmarks/results/models.md).
_SLIDING_BASE = 0.14  # per X
_MAX_RATIO = 0.5  # X to which they are computed


def other_layers(
    parameters: Sequence[Parameter], theta: Sequence[float], indenter: Indenter, thickness: Layer, depth: float
) -> dict[str, tuple[float, ...]]:
    """Return the parameter values of the same force at a depth [m] under each other layer, by its name.

    The force is E A(d) c(d) + eta (A c)'(d) d', up to constants: an elastic parameter is multiplied by the ratio of
    A c, a viscous one by that of its derivative, this layer's over the other one's. The other layers of
    - a tip that no correction is known for, a specimen stated to be a half-space, or a table of factors: none;
    - a specimen without a declared thickness: a bonded one of 22 mm by Garcia's law;
    - "garcia" under a sphere: "dimitriadis"; "dimitriadis", bonded: "garcia"; "finite-cylinder": "dimitriadis";
    - both published laws under a sphere, deeper than a tenth of the height that they are derived for: in addition
      "finite-cylinder", which is fitted to finite elements at large strain;
    - "dimitriadis" on a base that slides: in addition the finite elements of a base without friction.
    """
    alternatives = {}
    # The declared layer has a correction for the tip: a model without one is refused when it is built.
    corrected_area, area_slope = corrected_contact(indenter, thickness, depth)
    for name, layer in _other_corrections(indenter, thickness, depth).items():
        try:
            other_area, other_slope = corrected_contact(indenter, layer, depth)
        except ValueError:  # no correction is known for the tip
            continue
        ratios = {"elastic": corrected_area / other_area, "viscous": area_slope / other_slope}
        alternatives[name] = _scaled(parameters, theta, ratios)
    # A softer base makes the same force mean a stiffer material, by finite elements up to a contact of half the height.
    if isinstance(thickness, Thickness) and thickness.law == "dimitriadis" and not thickness.is_bonded:
        ratio = min(indenter.contact_radius(depth) / thickness.height, _MAX_RATIO)
        stiffening = 1.0 / (1.0 - _SLIDING_BASE * ratio)
        ratios = {"elastic": stiffening, "viscous": stiffening}
        alternatives["a base without friction"] = _scaled(parameters, theta, ratios)
    return alternatives


def _scaled(parameters: Sequence[Parameter], theta: Sequence[float], ratios: dict[str, float]) -> tuple[float, ...]:
    """Return parameter values times the ratio of their role; those of no role stay."""
    pairs = zip(parameters, theta, strict=True)
    return tuple(value * ratios.get(parameter.role or "", 1.0) for parameter, value in pairs)


def _other_corrections(indenter: Indenter, thickness: Layer, depth: float) -> dict[str, Thickness]:
    """Return the corrections of the other layers by name, see `other_layers`.

    They are built without the checks of `Thickness`, such as that a finite cylinder needs its diameter: only their
    factor is used.
    """
    if thickness is None:
        usual = Thickness.model_construct(law="garcia", height=USUAL_HEIGHT)
        return {f"a bonded layer of {1e3 * USUAL_HEIGHT:.0f} mm": usual}
    if not isinstance(thickness, Thickness) or thickness.law == "table":
        return {}
    corrections: dict[str, Thickness] = {}
    if thickness.law == "dimitriadis":
        if thickness.is_bonded:
            corrections["garcia"] = thickness.model_copy(update={"law": "garcia"})
    elif thickness.treats_as_sphere(indenter):
        corrections["dimitriadis"] = thickness.model_copy(
            update={"law": "dimitriadis", "sticking": False, "diameter": None}
        )
    is_deep = depth > _MAX_STRAIN * thickness.height
    if is_deep and thickness.law != "finite-cylinder" and thickness.treats_as_sphere(indenter):
        corrections["finite-cylinder"] = thickness.model_copy(update={"law": "finite-cylinder"})
    return corrections
