"""The lines of a run's report that say how it agrees with a reference."""

from __future__ import annotations

from typing import Any

from palpate_engine import Result, bounded_text, display_unit, json_document
from palpate_kit.terminal.quantities import value_with_uncertainty

from palpate_reference.agreement.agree_command import AGREEMENT


def agreement_lines(result: Result) -> list[str]:
    """Return a line for a run compared by `palpate material agree`: ``agreement: elasticity ..., reference ..., E_n
    0.40``."""
    path = result.folder / AGREEMENT
    if not path.is_file():
        return []
    found: dict[str, Any] = json_document(bounded_text(path))
    word, factor = display_unit(found["unit"])
    own, other = (
        value_with_uncertainty(factor * found[name], factor * found[std])
        for name, std in (("value", "std"), ("reference", "reference_std"))
    )
    agrees = "agrees" if abs(found["e_n"]) <= 1 else "does not agree"
    line = f"agreement: {found['quantity']} {own} {word}, reference {other} {word}: E_n {found['e_n']:.2f}, {agrees}"
    return [line, *(f"not the same: {remark}" for remark in found["remarks"])]
