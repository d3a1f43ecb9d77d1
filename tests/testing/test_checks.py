"""The conformance checks: what they let pass, and what they catch, in words."""

import numpy as np
import pytest
from palpate import (
    Batch,
    Belief,
    Channel,
    ContactModel,
    Device,
    Estimator,
    Indenter,
    Parameter,
    Setpoint,
    Stream,
    Trajectory,
    track_by_step,
)
from palpate_models import DimensionalityReduction, Flat, Power, Sphere
from palpate_testing import check_device, check_estimator, check_indenter, check_model, check_trajectory


class Tip(Indenter):
    """A tip whose contact radius is given by a function."""

    curve: object = None
    area: object = None

    def contact_radius(self, depth):
        return self.curve(depth)

    def profile_area(self, depth):
        return self.area(depth) if self.area else super().profile_area(depth)


@pytest.mark.parametrize(
    "tip",
    [
        Sphere(radius=0.0025),
        Sphere(radius=0.01),
        Flat(radius=0.005),
        *(Power(exponent=n, coefficient=50.0) for n in (1, 2, 3, 4, 6)),
    ],
)
def test_good_tips_pass(tip):
    check_indenter(tip)
    check_model(DimensionalityReduction(indenter=tip), (1e5, 300.0))


@pytest.mark.parametrize(
    ("tip", "words"),
    [
        (Tip(curve=lambda d: 0.001 / (1 + 1000 * d)), "is not monotone: it falls beyond a depth of"),
        (Tip(curve=lambda d: (0.004 - d) ** 0.5), r"raises at depth|is nan at depth"),
        (Tip(curve=lambda d: d * float("nan")), "is nan at depth 1e-06 m"),
        (Tip(curve=lambda d: {}["no"]), "Tip.contact_radius raises at depth 1e-06 m: KeyError"),
        (Tip(curve=lambda d: d**0.5, area=lambda d: d), "the derivative of profile_area is not contact_radius"),
        (Tip(curve=lambda d: d**0.5, area=lambda d: 1e-3 + 2 / 3 * d**1.5), "is not 0 at touch"),
        (Tip(curve=lambda d: -(d**0.5)), "is not monotone|negative"),
    ],
)
def test_bad_tips_are_told_what_is_wrong(tip, words):
    with pytest.raises(AssertionError, match=words):
        check_indenter(tip)


class Spring(ContactModel):
    """F = K d + B d'."""

    parameters = (Parameter("k", "K", "N/m", "stiffness"), Parameter("b", "B", "N*s/m", "damping"))
    faults: tuple[str, ...] = ()

    def force(self, depth, rate, theta, memory=()):
        sign = -1.0 if "pulls when pressed faster" in self.faults else 1.0
        return theta[0] * depth + sign * theta[1] * rate

    def delay_shift(self, theta):
        return (0.0,) if "shift" in self.faults else (0.0, -theta[0])


def test_models():
    check_model(Spring(), (300.0, 5.0))
    with pytest.raises(AssertionError, match="smaller when pressed faster"):
        check_model(Spring(faults=("pulls when pressed faster",)), (300.0, 5.0))
    with pytest.raises(AssertionError, match="delay_shift gives 1 numbers for 2"):
        check_model(Spring(faults=("shift",)), (300.0, 5.0))
    with pytest.raises(AssertionError, match="out of its own bounds"):
        check_model(Spring(), (-300.0, 5.0))
    with pytest.raises(AssertionError, match="2 parameters, 1 given"):
        check_model(Spring(), (300.0,))


class Oracle(Estimator):
    """Answers what it is told to."""

    answer: object = None

    def start(self, problem):
        count = [0]

        def step(moment):
            count[0] += 1
            return self.answer(moment, count[0])

        return track_by_step(2, step)


def belief(values=(1.0, 2.0), std=(0.1, 0.1)):
    return Belief(np.array(values), np.array(std), 0.003, 1e-4, 1.0)


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda m, n: belief(), None),
        (
            lambda m, n: belief((1.0, 2.0), (-0.1, 0.1)),
            "negative standard deviation",
        ),
        (
            lambda m, n: belief((np.nan, 2.0), (0.1, 0.1)),
            "no number and no status",
        ),
        (
            lambda m, n: belief((1.0, 2.0), (np.nan, 0.1)),
            "without an uncertainty",
        ),
        (
            lambda m, n: belief(np.random.rand(2)),
            "other numbers on a second run",
        ),
    ],
)
def test_estimators(answer, words):
    model = DimensionalityReduction(indenter=Sphere(radius=0.005))
    if words is None:
        check_estimator(Oracle(answer=answer), model, (1e5, 300.0))
        return
    with pytest.raises(AssertionError, match=words):
        check_estimator(Oracle(answer=answer), model, (1e5, 300.0))


class Line(Trajectory):
    """Up or down along z."""

    height: object = None
    measuring: bool = True

    @property
    def total_duration(self):
        return 1.0

    def at(self, time):
        position = np.zeros((len(time), 3))
        position[:, 2] = self.height(np.clip(time, 0, 1))
        velocity = np.zeros((len(time), 3))
        inside = (time > 0) & (time < 1)
        late, early = self.height(time[inside] + 1e-6), self.height(time[inside] - 1e-6)
        velocity[inside, 2] = (late - early) / 2e-6
        return Setpoint(position, velocity, (time >= 0) & (time <= 1) & self.measuring)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (Line(height=lambda t: 0.01 * np.cos(2 * np.pi * t)), None),
        (Line(height=lambda t: 0.01 * t), "velocity jumps"),
        (Line(height=lambda t: 0.01 * (t > 0.5)), "moves at|jumps"),
        (Line(height=lambda t: np.cos(2 * np.pi * t)), "moves at 6.28 m/s, allowed 0.25"),
        (Line(height=lambda t: 0.01 * np.cos(2 * np.pi * t), measuring=False), "no part for measuring"),
        (Line(height=lambda t: np.nan * t), "not finite"),
    ],
)
def test_trajectories(line, words):
    if words is None:
        check_trajectory(line)
        return
    with pytest.raises(AssertionError, match=words):
        check_trajectory(line)


class Teller(Device):
    """Sends what it is told to."""

    sends: object = None

    @property
    def streams(self):
        return (Stream("s", (Channel("a", "m"), Channel("b", "N")), 100.0),)

    def connect(self, seed):
        from contextlib import nullcontext

        teller = self

        class Link:
            def batches(self):
                yield from teller.sends()

        return nullcontext(Link())


def batch(stream="s", width=2, kind=np.int64, stamps=3):
    time = np.arange(stamps).astype(kind)
    return Batch(stream, time, time, np.zeros((3, width)))


@pytest.mark.parametrize(
    ("sends", "words"),
    [
        (lambda: [batch()], None),
        (lambda: [], "sends nothing"),
        (lambda: [batch("t")], "does not announce"),
        (lambda: [batch(width=3)], "wrong width"),
        (lambda: [batch(kind=float)], "int64 nanoseconds"),
        (lambda: [batch(stamps=2)], "one time-stamp for each row"),
    ],
)
def test_devices(sends, words):
    if words is None:
        check_device(Teller(sends=sends))
        return
    with pytest.raises(AssertionError, match=words):
        check_device(Teller(sends=sends))
