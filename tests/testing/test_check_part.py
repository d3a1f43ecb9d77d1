"""``palpate check part``: the page of a part, and parts that have none."""

import pytest
from palpate_commands.distribution import distribution
from palpate_testing.part_measures import SPECIMEN

SIGNAL = 'signals.force={topic = "/wrench", field = "wrench.force.z", unit = "N"}'
WRONG_TIP = """
from palpate import Indenter, Length, plugin
class Own(Indenter):
    '''A sphere with a contact radius of sqrt(2 R d).'''
    radius: Length
    @property
    def sphere_radius(self):
        return self.radius
    def contact_radius(self, depth):
        return (2.0 * self.radius * depth) ** 0.5
@plugin
def palpate_indenters():
    return {"own": Own}
"""


def test_the_page_of_a_tip(palpate, tmp_path):
    done = palpate("check", "part", "sphere", "--set", "radius=5 mm", "-o", tmp_path / "page.md")
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "page.md").read_text()
    assert page.startswith("# sphere: indenter of palpate ")
    assert "Tested in simulation on palpate " in page
    assert "; not certified." in page
    assert "| `radius` | `0.005` |" in page
    assert "Passed `check_indenter`: contact radius finite" in page
    assert "| contact radius and area at 1 mm | 2.236 mm, 1.491 mm^2 |" in page


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("dr",), "| elasticity (elastic) |"),
        (("point", "--set", "bias=4 mm"), "| largest speed |"),
        (("plane", "--set", "tilt_x=10 deg"), "| height and slope at (0, 0) mm | 0 mm, 10 deg |"),
        (("sim", "--set", f"specimen={SPECIMEN}"), "| stream wrench | "),
    ],
)
def test_the_page_of_a_model_and_of_a_motion(palpate, words, line):
    done = palpate("check", "part", *words)
    assert done.returncode == 0, done.stderr
    assert line in done.stdout


@pytest.mark.slow
def test_the_page_of_an_estimator_has_its_errors(palpate):
    page = palpate("check", "part", "kinematic-ekf").stdout
    assert "| elasticity, 4 records of 4 s, almost without noise | bias " in page
    assert "within 2 u" in page


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("ros2", "--set", SIGNAL), "Ros2Device talks to hardware, and no twin stands in for it"),
        (("spere",), "did you mean 'sphere'"),
        (("sphere",), "radius"),
        (("sphere", "--set", "radius=5 N"), "'5 N' is a force, not a length"),
        (("sphere", "--set", "radius=5 mm", "-o", "no/page.md"), "cannot write"),
    ],
)
def test_what_has_no_page(palpate, words, complaint):
    done = palpate("check", "part", *words)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert any(word in done.stderr for word in complaint.split("|")), done.stderr


def test_a_wrong_part_has_no_page(palpate, tmp_path):
    (tmp_path / "own.py").write_text(WRONG_TIP)
    done = palpate("--plugin", tmp_path / "own.py", "check", "part", "own", "--set", "radius=5 mm")
    assert done.returncode == 2
    assert done.stdout == ""
    assert "a sphere rises to" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("bota", "port=/dev/ttyUSB0"), "| stream wrench | 800 Hz: x [N], "),
        (("rdt", 'host="192.0.2.1"'), "| stream wrench | 1000 Hz: x [N], "),
        (("rdt", 'host="192.0.2.1"', 'box="onrobot"', 'rate="500 Hz"'), "| stream wrench | 500 Hz: x [N], "),
        (
            ("ur", 'host="192.0.2.1"', 'tcp=["0 mm", "0 mm", "120 mm"]', 'work.origin=["-300 mm", "-130 mm", "0.1 m"]'),
            "| stream tip | 500 Hz: x [m], y [m], z [m]",
        ),
    ],
)
def test_a_sensor_and_an_arm_of_palpate_have_pages_of_their_twin(palpate, words, line):
    name, *settings = words
    done = palpate("check", "part", name, *(word for text in settings for word in ("--set", text)))
    assert done.returncode == 0, done.stderr
    assert line in done.stdout


@pytest.mark.slow
def test_an_arm_is_checked_against_its_twin(palpate, tmp_path):
    for path, text in distribution("arm", "palpate-mine").items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text)
    info = tmp_path / "palpate_mine-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Name: palpate-mine\nVersion: 0.1\n")
    (info / "entry_points.txt").write_text("[palpate]\nmine = palpate_mine\n")
    settings = ('host="127.0.0.1"', 'tcp=["0 mm", "0 mm", "120 mm"]', 'work.origin=["450 mm", "0 mm", "100 mm"]')
    words = [word for text in settings for word in ("--set", text)]
    done = palpate("check", "part", "mine", *words, PYTHONPATH=str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert "# palpate-mine:mine: device of palpate-mine 0.1 (mine)" in done.stdout
    assert "| stream tip | 500 Hz: x [m], y [m], z [m]" in done.stdout
    assert "| slow libraries that every command imports with it | none |" in done.stdout
