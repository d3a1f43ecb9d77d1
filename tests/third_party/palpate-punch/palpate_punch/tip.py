"""A sharpened pencil."""

import math

from palpate import Angle, Indenter
from pydantic import Field


class Pencil(Indenter):
    """A cone: a(d) = 2 d/(pi tan t), t the angle between cone and surface (Sneddon 1965)."""

    slope: Angle = Field(gt=0, lt=math.pi / 2, description="angle t between the cone and the surface")

    def contact_radius(self, depth):
        """2 d/(pi tan t) [m]."""
        return 2.0 * depth / (math.pi * math.tan(self.slope))
