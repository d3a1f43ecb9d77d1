"""Conformance checks for parts of your own: call one in a test; it raises AssertionError that says what is wrong.

::

    from palpate.testing import check_indenter

    def test_my_tip():
        check_indenter(MyTip(radius=0.005))
"""

from palpate.testing.contact import check_indenter, check_model
from palpate.testing.device import check_device
from palpate.testing.estimation import check_estimator, synthetic_samples
from palpate.testing.trajectory import check_trajectory

__all__ = [
    "check_device",
    "check_estimator",
    "check_indenter",
    "check_model",
    "check_trajectory",
    "synthetic_samples",
]
