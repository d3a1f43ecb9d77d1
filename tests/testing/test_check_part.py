"""``palpate check part``: the page of a part, and parts that have none."""

import pytest

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
        (("ur3e",), "talks to hardware|must be given|host"),
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
