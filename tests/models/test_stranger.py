"""A stranger's tip in a file beside the pipeline: simulation, filter and replay; and what is said of a wrong one."""

from __future__ import annotations

from pathlib import Path

import pytest
from palpate import ConfigurationError, PluginError
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline

TIP = '''
from palpate import Indenter, Length, plugin

class Cubic(Indenter):
    """A tip with the profile r^3/L^2."""
    length: Length

    def contact_radius(self, depth):
        {body}

@plugin
def palpate_indenters():
    return {{"cubic": Cubic}}
'''
RIGHT = "return (depth * self.length**2 / 2.356194490192345) ** (1 / 3)"  # k_3 = 3 pi/4
COMMON = """
[run]
plugins = ["my_tip.py"]
seed = 3

[alignment]
force = "{force}"
position = "{position}"
velocity = "{velocity}"
{more}
tip_mass = "140 g"

[indenter.mine]
type = "cubic"
length = "3 mm"

[model.dr]
type = "dimensionality-reduction"
indenter = "mine"

[estimator.ekf]
type = "ekf"
"""
RIG = """
[device.rig]
type = "sim"
specimen = { model = "dr", elasticity = "110 kPa", viscosity = "360 Pa*s" }

[trajectory.press]
type = "point"
bias = "4 mm"
amplitude = "1 mm"
frequency = "2 Hz"
duration = "6 s"

[sink.log]
type = "mcap"
"""


def pipeline(folder: Path, body: str = RIGHT, replay: Path | None = None) -> Path:
    (folder / "my_tip.py").write_text(TIP.format(body=body))
    path = folder / ("replay.toml" if replay else "live.toml")
    device = "log" if replay else "rig"
    channels = {"force": "wrench.z", "position": "tip.z", "velocity": "twist.z"}
    text = COMMON.format(
        **{role: f"{device}.{channel}" for role, channel in channels.items()},
        more=f'measuring = "{device}.setpoint.measuring"',
    )
    path.write_text(text + (f'[device.log]\ntype = "mcap-replay"\nfile = "{replay}"\n' if replay else RIG))
    return path


@pytest.mark.slow
def test_ten_lines_run_in_simulation_filter_and_replay(tmp_path):
    live = run_pipeline(load_pipeline(pipeline(tmp_path)), tmp_path / "live")
    found = live.tracks["dr/ekf"].parameters
    assert found["elasticity"].value == pytest.approx(110e3, rel=0.15)
    assert found["elasticity"].std > 0
    log = next((tmp_path / "live").glob("*.mcap"))
    file = pipeline(tmp_path, replay=log)
    text = file.read_text()
    replay = run_pipeline(load_pipeline(file), tmp_path / "replay")
    assert "cubic" in text
    assert replay.tracks["dr/ekf"].parameters["elasticity"].value == found["elasticity"].value


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("return depth**0.5 * (1 - 300 * depth)", r"contact_radius is not monotone: it falls beyond a depth of 0.0011"),
        ("return depth * float('nan')", r"contact_radius is nan at depth 1e-06 m"),
        ("raise KeyError('x')", r"contact_radius raises at depth 1e-06 m: KeyError: 'x'"),
        ("import math; return math.sqrt(depth)", r"contact_radius on an array raises TypeError: .*plain operators"),
        ("return -depth", r"contact_radius"),
        ("return 5e-3 * depth / 1e-3 if depth > 0 else 0.0", r"contact_radius on an array raises ValueError"),
        ("return 2e-3 + 0 * depth", r"twice the size does not have twice the radius"),
    ],
)
def test_a_wrong_tip_is_named_with_plugin_method_and_depth(tmp_path, body, words):
    with pytest.raises(PluginError, match=rf"plugin .*my_tip\.py: indenter 'cubic': Cubic.*{words}"):
        load_pipeline(pipeline(tmp_path, body))


def test_a_wrong_tip_is_found_where_it_hides_in_a_specimen(tmp_path):
    path = pipeline(tmp_path, "return depth * float('nan')")
    text = path.read_text().replace('type = "cubic"\nlength = "3 mm"', 'type = "sphere"\nradius = "5 mm"')
    hidden = '{ type = "dimensionality-reduction", indenter = { type = "cubic", length = "3 mm" } }'
    path.write_text(text.replace('model = "dr"', f"model = {hidden}"))
    with pytest.raises(PluginError, match=r"indenter 'cubic': Cubic\.contact_radius is nan"):
        load_pipeline(path)


def test_a_mistake_in_an_inner_part_is_shown_once(tmp_path):
    path = pipeline(tmp_path)
    path.write_text(path.read_text().replace('length = "3 mm"', 'length = "3 kPa"'))
    with pytest.raises(ConfigurationError) as error:
        load_pipeline(path)
    assert str(error.value).count("\n") == 0, error.value
    assert "[indenter.mine] length: '3 kPa' is a pressure" in str(error.value)
