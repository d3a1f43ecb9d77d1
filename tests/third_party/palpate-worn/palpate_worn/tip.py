"""A ball whose apex is worn to a flat face."""

from typing import Any

from palpate import Indenter, Length
from pydantic import Field


class WornSphere(Indenter):
    """A paraboloid of radius R whose apex is a flat face of radius b: d = a sqrt(a^2 - b^2)/R (Popov and Hess 2015)."""

    radius: Length = Field(gt=0, description="R of the ball")
    flat: Length = Field(gt=0, description="b of the worn face")

    def contact_radius(self, depth: Any) -> Any:
        """a^2 = (b^2 + sqrt(b^4 + 4 R^2 d^2))/2 [m^2]."""
        return ((self.flat**2 + self._root(depth)) / 2) ** 0.5

    def profile_area(self, depth: Any) -> Any:
        """A = a d - (a^2 - b^2)^1.5/(3 R) [m^2]."""
        beyond_face = 2 * (self.radius * depth) ** 2 / (self.flat**2 + self._root(depth))  # a^2 - b^2
        return self.contact_radius(depth) * depth - beyond_face**1.5 / (3 * self.radius)

    def _root(self, depth: Any) -> Any:
        return (self.flat**4 + (2 * self.radius * depth) ** 2) ** 0.5
