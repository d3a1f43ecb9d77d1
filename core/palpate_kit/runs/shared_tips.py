"""Tips of a resolved pipeline: one table for each, which the models on it name."""

from __future__ import annotations

from typing import Any

from palpate_engine import Source


def name_tips(source: Source) -> None:
    """Have models name the tip whose settings they repeat in a resolved pipeline: what changes it changes them, too."""
    tips, models = source.tables.get("indenter"), source.tables.get("model")
    if not isinstance(tips, dict) or not isinstance(models, dict):
        return
    for model in models.values():
        inner: Any = model.get("indenter") if isinstance(model, dict) else None
        if isinstance(inner, dict):
            model["indenter"] = next((name for name in tips if tips[name] == inner), inner)
