"""A filter that forgets."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import plugin

if TYPE_CHECKING:
    from palpate import Estimator

PALPATE_API = 1


@plugin
def palpate_estimators() -> dict[str, type[Estimator] | str]:
    """By name."""
    return {"fading-squares": "palpate_fading.filter:FadingSquares"}
