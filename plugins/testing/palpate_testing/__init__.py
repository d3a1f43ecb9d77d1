"""Conformance checks for parts of your own: call one in a test; it raises AssertionError with the reason.

::

    from palpate_testing import check_indenter

    def test_my_tip():
        check_indenter(MyTip(radius=0.005))
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader
from palpate import Check, plugin

if TYPE_CHECKING:
    from palpate_kit.acquisition.simulated_computer import simulated_time

    from palpate_testing.arm_checks import ArmTest
    from palpate_testing.contact_checks import check_indenter, check_model
    from palpate_testing.device_checks import check_device
    from palpate_testing.estimator_checks import check_estimator, synthetic_samples
    from palpate_testing.simulated_time_checks import check_simulated_time
    from palpate_testing.surface_checks import check_surface
    from palpate_testing.trajectory_checks import check_trajectory

__getattr__, _, _ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "arm_checks": ["ArmTest"],
        "contact_checks": ["check_indenter", "check_model"],
        "device_checks": ["check_device"],
        "estimator_checks": ["check_estimator", "synthetic_samples"],
        "simulated_time_checks": ["check_simulated_time", "simulated_time"],
        "surface_checks": ["check_surface"],
        "trajectory_checks": ["check_trajectory"],
    },
)

__all__ = [
    "ArmTest",
    "check_device",
    "check_estimator",
    "check_indenter",
    "check_model",
    "check_simulated_time",
    "check_surface",
    "check_trajectory",
    "simulated_time",
    "synthetic_samples",
]


@plugin
def palpate_offers() -> dict[str, dict[str, Check]]:
    """Every tip, and third-party contact models, before anything moves."""
    return {"check": {"conformance": Check("palpate_testing.third_party_checks:check_parts")}}
