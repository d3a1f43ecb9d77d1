"""A worn ball."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import plugin

if TYPE_CHECKING:
    from palpate import Indenter

PALPATE_API = 1


@plugin
def palpate_indenters() -> dict[str, type[Indenter] | str]:
    """By name."""
    return {"worn-sphere": "palpate_worn.tip:WornSphere"}
