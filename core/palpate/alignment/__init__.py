"""Alignment: streams with their own clocks and rates become samples at the instants of the position stream.

The samples do not depend on how the streams were cut into batches, so a replayed log gives those of the live run.
"""

from palpate.alignment.aligner import Aligner, AlignmentReport
from palpate.alignment.settings import SIGNAL_UNITS, AlignmentSettings, Signal

__all__ = ["SIGNAL_UNITS", "Aligner", "AlignmentReport", "AlignmentSettings", "Signal"]
