"""A tip and a filter for palpate."""

from palpate import plugin

from palpate_punch.filter import RecursiveLeastSquares
from palpate_punch.tip import Pencil


@plugin
def palpate_indenters():
    """Tips."""
    return {"pencil": Pencil}


@plugin
def palpate_estimators():
    """Filters."""
    return {"recursive-least-squares": RecursiveLeastSquares}
