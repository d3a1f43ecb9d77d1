"""What is left of a motion that was cut: its setpoints, and those of a rest that was cut again."""

import itertools

import numpy as np
import pytest
from palpate import Settings
from palpate_models.indenters.profile import Profile
from palpate_trajectories.approach import PressShape
from palpate_trajectories.grid_points import GridPoints
from palpate_trajectories.raster import Raster

PRESS = PressShape(bias=0.004)
WHOLE = [
    Raster(size=(0.02, 0.02), pitch=0.005, settle=0.5, press=PRESS),
    Raster(size=(0.02, 0.02), pitch=0.005, settle=0.5, press=PRESS, boustrophedon=False, angle=0.4),
    GridPoints(size=(0.01, 0.01), pitch=0.005, duration=1.0, press=PRESS),
    GridPoints(places=((0.0, 0.0), (0.01, 0.0), (0.004, 0.002), (0.0, 0.0)), duration=1.0, press=PRESS),
]
NAMES = ["raster", "raster of one direction", "grid", "places of a search"]


def done(motion, until):
    """The lines or points that the setpoints up to a time [s] have swept from end to end, or palpated in full."""
    time = np.arange(0.0, until, 0.01)
    point = motion.at(time)
    x, y = point.position[:, 0], point.position[:, 1]
    if isinstance(motion, GridPoints):
        keys = [(round(1e6 * a), round(1e6 * b)) if m else None for a, b, m in zip(x, y, point.measuring, strict=True)]
        return [key for key, run in runs(keys) if len(run) * 0.01 > motion.duration - 0.02]
    cos, sin = np.cos(motion.angle), np.sin(motion.angle)
    along, across = cos * x + sin * y, cos * y - sin * x
    line = (across + motion.pitch * (motion.lines - 1) / 2) / motion.pitch
    on = point.measuring & (np.abs(line - np.rint(line)) < 1e-6)
    keys = [round(float(number)) if here else None for number, here in zip(line, on, strict=True)]
    return [key for key, run in runs(keys) if np.ptp(along[run]) > motion.size[0] - 1e-5]


def runs(keys):
    """Stretches of one key, with their rows."""
    for key, group in itertools.groupby(range(len(keys)), keys.__getitem__):
        if key is not None:
            yield key, list(group)


def fresh(motion):
    """The same settings, built anew."""
    return type(motion).model_validate({name: getattr(motion, name) for name in type(motion).model_fields})


def pieces(motion, count):
    """What is made of a motion that is cut after a `count`-th of each piece, and what is left in the end."""
    while motion is not None:
        cut = motion.total_duration / count
        rest = motion.after(cut)
        if rest == motion:  # nothing whole was finished: this time it is not cut
            rest = None
            cut = motion.total_duration
        yield motion, cut, rest
        motion = rest


@pytest.mark.parametrize("whole", WHOLE, ids=NAMES)
def test_a_rest_is_the_motion_that_its_settings_say(whole):
    whole.at(np.zeros(1))
    rest = whole.after(0.6 * whole.total_duration)
    assert rest.total_duration == fresh(rest).total_duration < 0.7 * whole.total_duration
    time = np.linspace(0.0, rest.total_duration, 999)
    np.testing.assert_array_equal(rest.at(time).position, fresh(rest).at(time).position)


@pytest.mark.parametrize("whole", WHOLE, ids=NAMES)
def test_a_motion_cut_again_and_again_leaves_nothing_out_and_does_nothing_twice(whole):
    whole.at(np.zeros(1))
    cuts = list(pieces(whole, 2))
    assert len(cuts) > 2
    number = "first_line" if isinstance(whole, Raster) else "first_point"
    firsts = [getattr(motion, number) for motion, _, _ in cuts]
    assert firsts == sorted(set(firsts))
    made = [key for motion, cut, rest in cuts for key in done(motion, cut)]
    assert sorted(made) == sorted(done(whole, whole.total_duration))
    assert len(made) == (whole.lines if isinstance(whole, Raster) else len(whole.visits))


@pytest.mark.slow
def test_settings_forget_what_they_computed_when_they_are_copied_with_other_values():
    tip = Profile(formula="r**2 / (2 * R)", constants={"R": 5e-3}, radius=4e-3)
    before = float(tip.contact_radius(1e-3))
    assert before == pytest.approx((2 * 5e-3 * 1e-3 / 2) ** 0.5, rel=1e-6)
    blunt = tip.model_copy(update={"constants": {"R": 10e-3}})
    assert float(blunt.contact_radius(1e-3)) == pytest.approx(2**0.5 * before, rel=1e-6)
    deep = WHOLE[0].model_copy(deep=True)
    assert deep == WHOLE[0]
    assert deep.total_duration == WHOLE[0].total_duration


def test_no_settings_hide_anything_in_private_attributes():
    """A copy carries them; `cached_property` is what a copy drops."""

    def below(kind):
        return [kind, *(inner for part in kind.__subclasses__() for inner in below(part))]

    assert [part.__name__ for part in below(Settings) if part.__private_attributes__] == []
