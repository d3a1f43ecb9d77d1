"""Alignment: streams with their own clocks and rates become samples at the instants of the position stream.

The samples do not depend on how the streams were cut into batches, so a replayed log gives those of the live run.
"""

from palpate.alignment_report import AlignmentReport, SidewaysShare, TurnedTool
from palpate.alignment_settings import SIGNAL_UNITS, AlignmentSettings, Signal
from palpate.hesitation import Hesitations, hesitations
from palpate.stream_health import Health

from palpate_engine.alignment.aligner import Aligner
from palpate_engine.alignment.intake import Intake
from palpate_engine.alignment.ports import Port, Ports, channels, signals
from palpate_engine.alignment.signal_series import Series
from palpate_engine.alignment.tool_frame import GRAVITY, mounting_of

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
