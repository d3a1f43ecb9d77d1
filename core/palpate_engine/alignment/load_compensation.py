"""Load compensation: the force of the contact alone, without the sensor's offset and the weight of the tip."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from palpate.alignment_report import Tare
from palpate.alignment_settings import AlignmentSettings
from palpate.estimation import Samples

from palpate_engine.alignment.contact_threshold import SAMPLES_IN_A_ROW
from palpate_engine.alignment.tool_frame import GRAVITY


class LoadCompensation:
    """Subtracts the tare and, where the settings ask for it, the weight of the tip."""

    def __init__(self, settings: AlignmentSettings, tare: Tare) -> None:
        self.tare = tare
        self.pull = 0.0  # [N] how far below none the force stays for some samples in a row
        weighs = settings.weight == "removed" and settings.tip_mass is not None
        self._weight = (settings.tip_mass or 0.0) * GRAVITY if weighs else None  # [N]

    def compensated(self, samples: Samples) -> Samples:
        """Return the samples with the force of the contact."""
        force = samples.force - self.tare.offset
        return replace(samples, force=force if self._weight is None else force + self._weight)

    def watch_pull(self, samples: Samples) -> None:
        """Take note of compensated forces that are negative, or below the line of the air before contact."""
        force = samples.force if self.tare.air is None else samples.force - self.tare.air.at(samples.time)
        if len(force) < SAMPLES_IN_A_ROW:
            return
        windows = len(force) - SAMPLES_IN_A_ROW + 1
        # The highest of so many samples in a row: a pull lasts, a spike of noise does not.
        highest = force[:windows]
        for i in range(1, SAMPLES_IN_A_ROW):
            highest = np.maximum(highest, force[i : i + windows])  # NaN where one is
        self.pull = max(self.pull, -float(np.fmin.reduce(highest, initial=0.0)))
