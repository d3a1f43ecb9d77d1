"""Conformance checks for parts of your own: call one in a test; it raises AssertionError with the reason.

::

    from palpate_testing import check_indenter

    def test_my_tip():
        check_indenter(MyTip(radius=0.005))
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Check, lazily, plugin

if TYPE_CHECKING:
    from palpate_testing.contact import check_indenter, check_model
    from palpate_testing.device import check_device
    from palpate_testing.estimation import check_estimator, synthetic_samples
    from palpate_testing.simulated_time import check_simulated_time
    from palpate_testing.trajectory import check_trajectory

__getattr__ = lazily(
    __name__,
    {
        "palpate_testing.contact": "check_indenter check_model",
        "palpate_testing.device": "check_device",
        "palpate_testing.estimation": "check_estimator synthetic_samples",
        "palpate_testing.simulated_time": "check_simulated_time",
        "palpate_testing.trajectory": "check_trajectory",
    },
)

__all__ = [
    "check_device",
    "check_estimator",
    "check_indenter",
    "check_model",
    "check_simulated_time",
    "check_trajectory",
    "synthetic_samples",
]


@plugin
def palpate_checks() -> dict[str, Check]:
    """Every tip, and third-party contact models, before anything moves."""
    return {"conformance": Check("palpate_testing.loading:check_parts")}
