"""Contact models and tips."""

from palpate import ContactModel, Indenter, plugin

from palpate_models.dimensionality_reduction import DimensionalityReduction
from palpate_models.indenters import Flat, Power, Sphere


@plugin
def palpate_indenters() -> dict[str, type[Indenter]]:
    """Tips."""
    return {"sphere": Sphere, "flat": Flat, "power": Power}


@plugin
def palpate_models() -> dict[str, type[ContactModel]]:
    """Contact models."""
    return {"dimensionality-reduction": DimensionalityReduction}
