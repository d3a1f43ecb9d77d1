"""Alignment: streams with their own clocks and rates become samples at the instants of the position stream.

The samples do not depend on how the streams were cut into batches, so a replayed log gives those of the live run.
"""

from palpate.alignment.aligner import Aligner
from palpate.alignment.hesitation import Hesitations, hesitations
from palpate.alignment.intake import Intake
from palpate.alignment.ports import Port, Ports, channels, signals
from palpate.alignment.settings import SIGNAL_UNITS, AlignmentSettings, Signal
from palpate.alignment.signal_series import Series
from palpate.alignment.tool_frame import GRAVITY, mounting_of
from palpate.alignment_report import AlignmentReport, SidewaysShare, TurnedTool
from palpate.stream_health import Health

__all__ = [
    "GRAVITY",
    "SIGNAL_UNITS",
    "Aligner",
    "AlignmentReport",
    "AlignmentSettings",
    "Health",
    "Hesitations",
    "Intake",
    "Port",
    "Ports",
    "Series",
    "SidewaysShare",
    "Signal",
    "TurnedTool",
    "channels",
    "hesitations",
    "mounting_of",
    "signals",
]
