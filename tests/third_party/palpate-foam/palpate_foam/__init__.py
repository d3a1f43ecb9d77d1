"""A foam."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import plugin

if TYPE_CHECKING:
    from palpate import ContactModel

PALPATE_API = 1


@plugin
def palpate_models() -> dict[str, type[ContactModel] | str]:
    """By name."""
    return {"stiff-foam": "palpate_foam.model:StiffFoam"}
