"""A motion that the process which commands an arm checks, piece by piece, before anything of it is done."""

from __future__ import annotations

from palpate import ForceLaw

from palpate_arms.fence import Fence
from palpate_arms.force_control import refusal
from palpate_arms.setpoint_buffer import PERIOD, Plan
from palpate_arms.station_plane import pressed_in_at_the_end


class MotionOffer:
    """A plan of setpoints, and the law of a force that leads."""

    def __init__(self, plan: Plan, law: ForceLaw | None) -> None:
        self.plan, self.law = plan, law
        self.is_whole = False  # True once all of it was checked
        self._pieces = plan.pieces()

    def fault(self, fence: Fence, stop: float | None) -> str | None:
        """Return why the next piece, or at last the whole, breaks the limits; None where it keeps them.

        `stop` [N] of the force that is read; None where none is.
        """
        rows = next(self._pieces, None)
        if rows is not None:
            verdict = fence.table(rows)
            return None if verdict is None else verdict.text
        self.is_whole = True
        return pressed_in_at_the_end(self.plan.ends) or self._refusal(fence, stop)

    def _refusal(self, fence: Fence, stop: float | None) -> str | None:
        """Return why a force must not lead; None where it may, or none does."""
        law, limits = self.law, fence.limits
        if law is None or limits is None:  # without limits nothing moves at all
            return None
        return refusal(law, stop, limits["speed"], limits["acceleration"], len(self.plan) * PERIOD)
