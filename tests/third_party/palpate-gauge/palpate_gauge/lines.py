"""Lines of the gauge: microseconds, newton and micrometres, as in ``125000 -0.517 -2004.1``."""

from palpate import Channel

CHANNELS = (Channel("force", "N"), Channel("height", "m"))
MICRO = 1e-6


def parse_line(line: bytes) -> tuple[int, float, float]:
    """Return time [us], force [N] and height [m]; raises ValueError for a damaged line."""
    stamp, force, height = line.split()
    return int(stamp), float(force), MICRO * float(height)
