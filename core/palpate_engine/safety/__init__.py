"""Safety: what a motion may be, and the whole of it checked before anything moves."""

from palpate_engine.safety.motion_check import (
    MotionReport,
    check_motion,
    check_own_motion,
    check_setpoints,
    demand_safe,
)
from palpate_engine.safety.motion_limits import MotionLimits, Reach
from palpate_engine.safety.settings import SafetySettings

__all__ = [
    "MotionLimits",
    "MotionReport",
    "Reach",
    "SafetySettings",
    "check_motion",
    "check_own_motion",
    "check_setpoints",
    "demand_safe",
]
