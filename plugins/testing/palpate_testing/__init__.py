"""Conformance checks for parts of your own: call one in a test; it raises AssertionError with the reason.

::

    from palpate_testing import check_indenter

    def test_my_tip():
        check_indenter(MyTip(radius=0.005))
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Check, Command, plugin
from palpate_kit.lazy_names import lazy_names

if TYPE_CHECKING:
    from palpate_kit.acquisition.simulated_computer import simulated_time as simulated_time

    from palpate_testing.arm_checks import ArmTest as ArmTest
    from palpate_testing.device_checks import check_device as check_device
    from palpate_testing.discovery_checks import check_discovery as check_discovery
    from palpate_testing.estimator_checks import (
        check_estimator as check_estimator,
        synthetic_samples as synthetic_samples,
    )
    from palpate_testing.model_checks import check_model as check_model
    from palpate_testing.simulated_time_checks import check_simulated_time as check_simulated_time
    from palpate_testing.surface_checks import check_surface as check_surface
    from palpate_testing.tip_checks import check_indenter as check_indenter
    from palpate_testing.trajectory_checks import check_trajectory as check_trajectory


@plugin
def palpate_offers() -> dict[str, dict[str, Check]]:
    """Return the check of every tip and third-party contact model, before anything moves."""
    return {"check": {"conformance": Check("palpate_testing.third_party_checks:check_parts")}}


@plugin
def palpate_commands() -> dict[str, Command]:
    """Return the command that checks a part, and prints it as one page."""
    target = "palpate_testing.check_part_command:check_part"
    return {
        "check part": Command(target, "Check a part in simulation, for a page that its author can publish.", "extend")
    }


__getattr__, __all__ = lazy_names(
    __name__,
    "palpate_testing.arm_checks:ArmTest",
    "palpate_testing.device_checks:check_device",
    "palpate_testing.discovery_checks:check_discovery",
    "palpate_testing.estimator_checks:check_estimator",
    "palpate_testing.tip_checks:check_indenter",
    "palpate_testing.model_checks:check_model",
    "palpate_testing.simulated_time_checks:check_simulated_time",
    "palpate_testing.surface_checks:check_surface",
    "palpate_testing.trajectory_checks:check_trajectory",
    "palpate_kit.acquisition.simulated_computer:simulated_time",
    "palpate_testing.estimator_checks:synthetic_samples",
)
