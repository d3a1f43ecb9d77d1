"""A material with memory under a rig of which one fact is wrong; kinds and sizes written down before the first run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from verdict_records.changes import relaxing
from verdict_records.contact import Specimen
from verdict_records.rigs import Column

SHARES = (0.1, 0.4)  # of the modulus at rest, that relaxes in addition
TIMES = (0.1, 3.0)  # [s] in which it does
SIGMA = 50  # standard deviations of the wrong fact alone, on a material without memory
FACTS = (  # kinds of `wrongs` that are facts of the rig, and no property of the material
    "another exponent",
    "a lower exponent",
    "a bonded layer",
    "a pull in contact",
    "a base that gives",
    "a bent force",
    "a cable",
    "saturated",
    "another mass",
    "the log is the command",
    "zeroed in contact",
)


@dataclass(frozen=True)
class Remembering(Specimen):
    """A specimen with one Maxwell branch parallel to its spring."""

    share: float = 0.0
    tau: float = 1.0  # [s]

    def elastic(self, depth: Column) -> Column:
        """Force (m,) [N] of spring and branch."""
        at_rest = super().elastic(depth)
        return np.asarray(at_rest + self.share * relaxing(self, at_rest, self.tau))

    @property
    def apparent(self) -> tuple[float, float]:
        """E [Pa] and eta [Pa s] of the Kelvin-Voigt law that is nearest to the contact force."""
        depth = self.travel
        unit = Specimen(self.rig, 1.0, 1.0)
        columns = np.column_stack([unit.elastic(depth), unit.viscous(depth, self.rate_of(depth))])
        lengths = np.linalg.norm(columns, axis=0)
        sizes = np.linalg.lstsq(columns / lengths, self.force(depth), rcond=None)[0] / lengths
        return float(sizes[0]), float(sizes[1])


def remembering(specimen: Specimen, random: np.random.Generator) -> Remembering:
    """A specimen's material with a memory that is drawn."""
    share = float(random.uniform(*SHARES))
    tau = float(np.exp(random.uniform(*np.log(TIMES))))
    return Remembering(specimen.rig, specimen.elasticity, specimen.viscosity, share, tau)
