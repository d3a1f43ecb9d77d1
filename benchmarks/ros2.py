"""A recorded run by DDS, estimated live: lost, late, and what it costs. ``python benchmarks/ros2.py --seconds 60``.

The publisher is a program in C++ with Fast DDS, the library under rmw_fastrtps (apt install g++ libfastrtps-dev): it
plays a simulated run of palpate's, the tip's way as joint states of a UR3e (500 Hz) and the wrench (800 Hz, noise and
all, so that every message is another). palpate reads, records and estimates; then its own recording is estimated once
more. Late is an arrival after the time when it was written, over the least such time (some 0.1 ms). It ends with exit
code 1 where a message is lost, or the two results are not the same to the bit. ``--faster 6.25`` sends the wrench at
5 kHz. ``--time stamp`` has the header's stamps, which are the times of the run itself: late is then also what the
publisher was held up by.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import pytest  # noqa: E402
from palpate_devices.mcap_replay import McapReplay  # noqa: E402
from palpate_engine import load_pipeline, run_pipeline  # noqa: E402

from tests.ros2 import playing  # noqa: E402
from tests.ros2.conftest import built  # noqa: E402
from tests.ros2.test_recorded_run import missed, replayed, streams_of  # noqa: E402

_DOMAIN, _PORT = 77, 17447


def cpu(who: int) -> float:
    """Seconds of processor that this process, or those that it has waited for, have taken."""
    used = resource.getrusage(who)
    return used.ru_utime + used.ru_stime


def publisher(folder: Path, streams: dict[str, tuple[np.ndarray, np.ndarray]], middleware: str) -> subprocess.Popen:
    """The program that plays a run, once somebody listens."""
    table = folder / "playback"
    if middleware == "zenoh":
        table.write_text(json.dumps(playing.zenoh_table(streams)))
        script = Path(playing.__file__).with_name("zenoh_publisher.py")
        command = [sys.executable, str(script), str(_PORT), str(_DOMAIN), str(table)]
    else:
        table.write_bytes(playing.playback(streams))
        command = [str(built("publisher")), str(_DOMAIN), str(table)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL)


def listening(folder: Path, seconds: float, time: str, middleware: str) -> Path:
    """The pipeline that listens for so long [s]."""
    text = playing.LISTENING.format(domain=_DOMAIN, seconds=seconds, origin=playing.origin())
    file = folder / "live.toml"
    text = text.replace('clocks = "one"', f'clocks = "one"\ntime = "{time}"')
    if middleware == "zenoh":
        text = text.replace('interface = "lo"', f'middleware = "zenoh"\npeers = ["127.0.0.1:{_PORT}"]')
    file.write_text(text)
    return file


def lateness(log: Path) -> list[float]:
    """Of the wrench's messages [ms], over the least: p50, p99, max."""
    late = []
    with McapReplay(file=log, recorded="ros").connect(0) as link:
        late = [batch.received - batch.time for batch in link.batches() if batch.stream == "wrench"]
    found = np.concatenate(late) / 1e6
    return [round(float(x), 3) for x in np.percentile(found - found.min(), (50, 99, 100))]


def measure(folder: Path, seconds: float, faster: float, time: str, middleware: str) -> dict[str, object]:
    """What came of it."""
    streams = playing.recorded(folder, seconds * faster)
    streams = {name: (times / faster, values) for name, (times, values) in streams.items()}
    pipeline = load_pipeline(listening(folder, seconds, time, middleware))
    with publisher(folder, streams, middleware) as program:
        try:
            before = [cpu(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
            live = run_pipeline(pipeline, folder / "live")
            spent = [cpu(who) - b for who, b in zip((resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN), before)]
        finally:
            program.kill()
    came = streams_of(live.folder / "log.mcap")
    again = replayed(live, folder)
    same = [(run.folder / "estimates.csv").read_bytes() for run in (live, again)]
    parameters = live.tracks["dr/kinematic"].table()["parameters"]
    topics = live.run["live"]["devices"]["ros"]["topics"]
    return {
        "seconds": seconds,
        "load": [round(x, 1) for x in os.getloadavg()],
        "messages": {name: topic["messages"] for name, topic in topics.items()},
        "lost": missed(streams["wrench"][1][:, [0, 2]], came["wrench"]),
        "missing by stamps": {name: topic["missing"] for name, topic in topics.items()},
        f"late over the least, by {time} [ms], p50, p99, max": lateness(live.folder / "log.mcap"),
        "from arrival to estimate [s]": live.run["live"].get("estimates"),
        "processor of the listening process [%]": round(100 * spent[1] / seconds, 1),
        "processor of the main process, with estimates and recording [%]": round(100 * spent[0] / seconds, 1),
        "the recording gives the same to the bit": same[0] == same[1],
        "estimates": {name: (entry["value"], entry["std"]) for name, entry in parameters.items()},
        "flags": [str(flag.code) for flag in live.flags],
    }


def main() -> None:
    """Measure, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--faster", type=float, default=1.0)
    parser.add_argument("--time", choices=["publish", "stamp"], default="publish")
    parser.add_argument("--middleware", choices=["dds", "zenoh"], default="dds")
    options = parser.parse_args()
    try:
        with tempfile.TemporaryDirectory() as folder:
            found = measure(Path(folder), options.seconds, options.faster, options.time, options.middleware)
    except pytest.skip.Exception as error:
        sys.exit(str(error))
    print(json.dumps(found, indent=2))
    sys.exit(bool(found["lost"]) or not found["the recording gives the same to the bit"])


if __name__ == "__main__":
    main()
