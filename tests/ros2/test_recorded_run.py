"""A recorded run, published by a program that is not ours, and estimated live."""

import itertools
import json
import re

import numpy as np
import pytest
from palpate_devices.mcap_replay import McapReplay
from palpate_engine import load_pipeline, run_pipeline

from tests.ros2 import playing

pytestmark = pytest.mark.talks


def streams_of(log):
    found = {}
    with McapReplay(file=log, recorded="ros").connect(0) as link:
        for batch in link.batches():
            found.setdefault(batch.stream, []).append(batch.values)
    return {name: np.concatenate(parts) for name, parts in found.items()}


def replayed(result, folder):
    """The same pipeline over the recording of a run."""
    table = f'[device.ros]\ntype = "mcap-replay"\nfile = "{result.folder / "log.mcap"}"\nrecorded = "ros"\n'
    tables = re.split(r"\n(?=\[)", (result.folder / "pipeline.toml").read_text())
    kept = [part for part in tables if not part.startswith(("[device.ros", "[sink"))]
    file = folder / "again.toml"
    file.write_text("\n".join([*kept, table]))
    return run_pipeline(load_pipeline(file), folder / "again")


def missed(sent, came):
    """Rows of what was sent that lie between the first and the last that came, and did not come."""
    where = {row.tobytes(): k for k, row in enumerate(sent)}
    places = [where[row.tobytes()] for row in came]  # what came has been sent, to the bit
    assert all(a < b for a, b in itertools.pairwise(places))
    return places[-1] - places[0] + 1 - len(places)


@pytest.mark.gate
@pytest.mark.slow
def test_a_recorded_run_is_estimated_as_it_was_and_as_its_own_recording_says(publish, domain, tmp_path):
    streams = playing.recorded(tmp_path, 4)
    publish(playing.playback(streams))
    file = tmp_path / "live.toml"
    seconds = streams["tip"][0][-1] - 1.5
    file.write_text(playing.LISTENING.format(domain=domain, seconds=seconds, origin=playing.origin()))
    live = run_pipeline(load_pipeline(file), tmp_path / "live")
    came = streams_of(live.folder / "log.mcap")
    assert missed(streams["wrench"][1][:, [0, 2]], came["wrench"]) == 0
    again = replayed(live, tmp_path)
    assert (live.folder / "estimates.csv").read_bytes() == (again.folder / "estimates.csv").read_bytes()
    tables = [json.loads((r.folder / "result.json").read_text())["tracks"]["dr/kinematic"] for r in (live, again)]
    assert tables[0]["parameters"] == tables[1]["parameters"]
    elasticity, viscosity = (tables[0]["parameters"][name] for name in ("elasticity", "viscosity"))
    assert elasticity["value"] == pytest.approx(112.5e3, rel=0.03)
    assert viscosity["value"] == pytest.approx(362, rel=0.1)
    assert live.run["live"]["devices"]["ros"]["topics"]["/wrench"]["missing"] == 0
