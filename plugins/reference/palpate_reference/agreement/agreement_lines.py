"""The lines of a run's report on its agreement with a reference."""

from __future__ import annotations

from typing import Any

from palpate_engine import Result, bounded_text, display_unit, json_document
from palpate_kit.terminal.quantities import value_with_uncertainty

from palpate_reference.agreement.agree_command import AGREEMENT


def agreement_lines(result: Result) -> list[str]:
    """Return a line for a run that `palpate material agree` has compared, and one for each remark.

    The line is as ``agreement: elasticity ..., reference ..., E_n 0.40``; E_n up to 1 agrees (ISO 13528).
    """
    path = result.folder / AGREEMENT
    if not path.is_file():
        return []
    pair: dict[str, Any] = json_document(bounded_text(path))
    unit, factor = display_unit(pair["unit"])
    value = value_with_uncertainty(factor * pair["value"], factor * pair["std"])
    reference = value_with_uncertainty(factor * pair["reference"], factor * pair["reference_std"])
    verdict = "agrees" if abs(pair["e_n"]) <= 1 else "does not agree"
    line = (
        f"agreement: {pair['quantity']} {value} {unit}, reference {reference} {unit}: E_n {pair['e_n']:.2f}, {verdict}"
    )
    return [line, *(f"not the same: {remark}" for remark in pair["remarks"])]
