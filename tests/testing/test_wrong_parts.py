"""Seventy wrong parts, of which the checks find at least 65, and right ones that stay green with the same bounds."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from palpate import (
    Batch,
    Channel,
    ContactModel,
    Device,
    Estimator,
    Indenter,
    MaterialValue,
    Parameter,
    Setpoint,
    Stream,
    Trajectory,
    select,
)
from palpate.offers import import_target
from palpate_filters import KinematicFilter, palpate_estimators
from palpate_fits import palpate_estimators as palpate_fits
from palpate_models import DimensionalityReduction, Sphere
from palpate_testing import check_device, check_estimator, check_indenter, check_model, check_trajectory

RADIUS = 5e-3
TRUTH = (1e5, 300.0)


def sphere(radii):
    """Height of a sphere's surface."""
    return RADIUS - np.sqrt(RADIUS**2 - np.minimum(radii, RADIUS) ** 2)


def paraboloid(radii):
    return radii**2 / (2 * RADIUS)


class Tip(Indenter):
    """A paraboloid of 5 mm, or what is wrong with it."""

    curve: object = None
    area: object = None
    sphere: bool = False

    @property
    def sphere_radius(self):
        return RADIUS if self.sphere else None

    def contact_radius(self, depth):
        return self.curve(depth)

    def profile_area(self, depth):
        return self.area(depth) if self.area else super().profile_area(depth)


def right_radius(depth):
    return (RADIUS * depth) ** 0.5


RANDOM = np.random.default_rng(0)
TIPS = {
    "2 x": {"curve": lambda d: 2 * right_radius(d)},
    "sqrt 2 x": {"curve": lambda d: 2**0.5 * right_radius(d)},
    "area not of its radius": {"curve": right_radius, "area": lambda d: d * right_radius(d)},
    "answers in mm": {"curve": lambda d: 1e3 * right_radius(d)},
    "takes mm": {"curve": lambda d: right_radius(1e3 * d)},
    "not monotone": {"curve": lambda d: right_radius(d) / (1 + 1e6 * d * d)},
    "NaN at 0": {"curve": lambda d: d / (d * RADIUS) ** 0.5 * RADIUS},
    "negative": {"curve": lambda d: -right_radius(d)},
    "infinite": {"curve": lambda d: right_radius(d) / (0 * d)},
    "jumps": {"curve": lambda d: select(d, 1e-3, 1.5 * right_radius(d), right_radius(d))},
    "valid beyond 30 radii": {"curve": right_radius, "sphere": True},
    "random": {"curve": lambda d: right_radius(d) * RANDOM.uniform(0.99, 1.01)},
}


def test_a_right_tip_has_the_shape_that_is_drawn():
    check_indenter(Tip(curve=right_radius), shape=paraboloid)
    check_indenter(Sphere(radius=RADIUS), depths=np.geomspace(1e-6, 1e-4, 30), shape=sphere)


def finds_tip(settings):
    check_indenter(Tip(**settings), shape=paraboloid)


class Press(ContactModel):
    """F = A(d) E + a(d) B d' of the paraboloid, or what is wrong with it."""

    parameters = (
        Parameter("elasticity", "E", "Pa", "modulus", role="elastic", start=1e5),
        Parameter("viscosity", "eta", "Pa*s", "viscosity", role="viscous", start=300.0),
    )
    law: object = None
    shift: object = None
    gradients: object = None

    def force(self, depth, rate, theta, memory=()):
        return (self.law or right_law)(depth, rate, theta)

    def material(self, theta):
        gradients = self.gradients or ((1.0, 0.0), (0.0, 1.0))
        return (MaterialValue("elasticity", theta[0], gradients[0]), MaterialValue("viscosity", theta[1], gradients[1]))

    def delay_shift(self, theta):
        return self.shift(theta) if self.shift else (0.0, -theta[0])


def area(depth):
    return 2 / 3 * RADIUS**0.5 * depth**1.5


def right_law(depth, rate, theta):
    return 2 * theta[0] * area(depth) + 2 * theta[1] * right_radius(depth) * rate


def with_parameters(*parameters):
    return type("Press", (Press,), {"parameters": parameters, "__module__": __name__})


E, ETA = Press.parameters
SWAPPED = with_parameters(replace(E, role="viscous"), replace(ETA, role="elastic"))


class Forgetful(Press):
    """Its memory has one state and two rates."""

    memory = ("a",)

    def memory_rate(self, depth, rate, theta, memory):
        return (0.0 * depth, 0.0 * depth)


class Rooted(Press):
    """Its memory follows a root of the depth, which is complex out of contact."""

    memory = ("a",)

    def memory_rate(self, depth, rate, theta, memory):
        return (depth**1.5 - memory[0],)


MODELS = {
    "damping negative": {"law": lambda d, v, p: right_law(d, -v, p)},
    "damping negative when leaving": {
        "law": lambda d, v, p: right_law(d, 0.0, p) + 2 * p[1] * right_radius(d) * select(v, 0.0, v, -v)
    },
    "damping zero": {"law": lambda d, v, p: right_law(d, 0.0 * v, p)},
    "elasticity negative": {"law": lambda d, v, p: right_law(d, v, (-p[0], p[1]))},
    "NaN": {"law": lambda d, v, p: right_law(d, v, p) * float("nan")},
    "random": {"law": lambda d, v, p: right_law(d, v, p) * RANDOM.uniform(0.9, 1.1)},
    "infinite slope at touch": {"law": lambda d, v, p: 1e-4 * p[0] * d**0.5 + 2 * p[1] * right_radius(d) * v},
    "roles swapped": {"part": SWAPPED},
    "a parameter that enters squared": {"law": lambda d, v, p: right_law(d, v, (1e-5 * p[0] ** 2, p[1]))},
    "a parameter without effect": {"part": with_parameters(E, ETA, Parameter("extra", "x", "1", "nothing"))},
    "jump of 1 N": {"law": lambda d, v, p: right_law(d, v, p) + select(d, 2e-3, 1.0, 0.0)},
    "gradient x 1000": {"gradients": ((1e3, 0.0), (0.0, 1.0))},
    "gradient too short": {"gradients": ((1.0,), (0.0, 1.0))},
    "delay_shift wrong": {"shift": lambda p: (0.0, +p[0])},
    "unit unknown": {"part": with_parameters(replace(E, unit="Paa"), ETA)},
    "start out of bounds": {"part": with_parameters(replace(E, start=-1.0), ETA)},
    "two parameters of one name": {"part": with_parameters(E, replace(ETA, name="elasticity"))},
    "memory of the wrong length": {"part": Forgetful},
}


def test_a_right_model_is_green():
    check_model(Press(), TRUTH)


def test_a_memory_is_asked_out_of_contact():
    with pytest.raises(AssertionError, match="memory_rate is not a finite number at depth -0"):
        check_model(Rooted(), TRUTH)


def finds_model(settings):
    part = settings.get("part", Press)
    model = part(**{key: value for key, value in settings.items() if key != "part"})
    check_model(model, [*TRUTH, 1.0][: len(model.parameters)])


MODEL = DimensionalityReduction(indenter=Sphere(radius=RADIUS))


class Wrong(Estimator):
    """The kinematic filter behind a mistake."""

    mistake: object = None

    def start(self, problem):
        wrong = self

        class Tracker:
            def __init__(self):
                self.tracker = KinematicFilter().start(problem)
                self.seen = 0

            def run(self, samples):
                estimates = self.tracker.run(samples)
                found = wrong.mistake(estimates, samples, self) if wrong.mistake else estimates
                self.seen += len(samples)
                return found

        return Tracker()


def changed(**functions):
    return lambda estimates, samples, tracker: replace(
        estimates, **{name: function(getattr(estimates, name)) for name, function in functions.items()}
    )


def learns_in_air(estimates, samples, tracker):
    idle = ~samples.active
    values, std = estimates.values.copy(), estimates.std.copy()
    values[idle], std[idle] = TRUTH, (1e3, 10.0)
    return replace(estimates, values=values, std=std)


def ahead(estimates, samples, tracker):
    return replace(estimates, values=estimates.values * (1 + 1e-9 * np.nan_to_num(samples.force[-1])))


def silent(estimates, samples, tracker):
    values = estimates.values.copy()
    values[(samples.time > 1.5) & (samples.time < 1.52)] = np.nan
    return replace(estimates, values=values)


def writes(estimates, samples, tracker):
    samples.force[:] -= 0.05
    return estimates


def slow(estimates, samples, tracker):
    from time import process_time

    begin = process_time()
    while process_time() - begin < 3.0 * float(samples.interval.sum()):
        pass
    return estimates


def constant(estimates, samples, tracker):
    values = np.where(np.isfinite(estimates.values), np.array([5e4, 100.0]), np.nan)
    return replace(estimates, values=values, std=estimates.std * 1e2)


FILTERS = {
    "depends on how a record is cut": lambda e, s, t: replace(e, values=e.values * (1 + 1e-6 * (t.seen > 0))),
    "looks ahead": ahead,
    "depends on the length of blocks": lambda e, s, t: replace(e, values=e.values * (1 + 1e-9 * len(s))),
    "learns out of contact": learns_in_air,
    "random": changed(values=lambda v: v * RANDOM.uniform(0.99, 1.01)),
    "wrong shape": changed(values=lambda v: v[:, :1]),
    "silent NaN": silent,
    "std / 30": changed(std=lambda s: s / 30),
    "std x 30": changed(std=lambda s: s * 30),
    "variance for std": changed(std=lambda s: s**2),
    "E + 10 %": changed(values=lambda v: v * np.array([1.1, 1.0])),
    "E and eta swapped": changed(values=lambda v: v[:, ::-1], std=lambda s: s[:, ::-1]),
    "eta below 0": changed(values=lambda v: v * np.array([1.0, -1.0])),
    "never learns": constant,
    "NIS x 100": changed(nis=lambda n: 100 * n),
    "sign of the surface": lambda e, s, t: replace(e, surface=2 * s.position - e.surface),
    "time one sample late": lambda e, s, t: replace(e, time=e.time + 2e-3),
    "sign of the inertia": None,
    "writes into its input": writes,
    "slower than real time by 3": slow,
}


def finds_filter(mistake):
    part = Wrong(mistake=mistake) if mistake else WrongInertia()
    check_estimator(part, MODEL, TRUTH, truth=True)


class WrongInertia(Estimator):
    """The kinematic filter on u - 2 m z'', as if m z'' had the other sign in u + m z'' = F."""

    online = False  # differences of the position, which is exact, need the whole record

    def start(self, problem):
        class Tracker:
            def run(self, samples):
                z, interval = samples.position, samples.interval
                acceleration = np.zeros(len(z))
                acceleration[1:-1] = (z[2:] - 2 * z[1:-1] + z[:-2])[: max(len(z) - 2, 0)] / interval[1:-1] ** 2
                force = samples.force - 2 * problem.tip_mass * acceleration
                return KinematicFilter().start(problem).run(replace(samples, force=force))

        return Tracker()


class Line(Trajectory):
    """Down to 4 mm and up again in 4 s, or what is wrong with it."""

    height: object = None
    span: float = 4.0
    stated: object = None

    @property
    def total_duration(self):
        return self.stated or self.span

    def at(self, time):
        height = self.height or right_height
        position, velocity = np.zeros((len(time), 3)), np.zeros((len(time), 3))
        inside = (time > 0) & (time < self.span)
        position[:, 2] = height(np.clip(time, 0, self.span))
        velocity[inside, 2] = (height(time[inside] + 1e-6) - height(time[inside] - 1e-6)) / 2e-6
        return Setpoint(position, velocity, (time >= 0) & (time <= self.span))


def right_height(time, top=2e-3, depth=4e-3):
    return top - (top + depth) * np.sin(np.pi * time / 4.0) ** 2


class Backwards(Line):
    """Answers the times in falling order."""

    def at(self, time):
        return super().at(time[::-1])


MOTIONS = {
    "upside down": Line(height=lambda t: -right_height(t) + 4e-3),
    "starts inside the skin": Line(height=lambda t: right_height(t) - 3e-3),
    "ends in contact": Line(height=lambda t: 2e-3 - 6e-3 * np.sin(np.pi * t / 8.0) ** 2),
    "jumps": Line(height=lambda t: right_height(t) - 1e-3 * ((t > 1.5) & (t < 2.5))),
    "over its speed": Line(height=lambda t: 0.5 - 0.504 * np.sin(np.pi * t / 4.0) ** 2),
    "NaN": Line(height=lambda t: right_height(t) * np.where(np.abs(t - 2.0) < 0.1, np.nan, 1.0)),
    "time falls": Backwards(height=lambda t: right_height(t) + 1e-3 * np.sin(np.pi * t / 4.0) ** 4 * (t - 2.0)),
    "not the depth it says": Line(height=lambda t: right_height(t, depth=3e-3)),
    "longer than it says": Line(stated=3.0),
}


def test_a_right_motion_is_green():
    check_trajectory(Line(), depth=4e-3)


def finds_motion(motion):
    check_trajectory(motion, depth=4e-3)


class Sensor(Device):
    """A force sensor and the height of a stage, 500 Hz, or what is wrong with it."""

    wrong: object = None

    @property
    def streams(self):
        return (Stream("", (Channel("fz", "N"), Channel("z", "m")), 500.0),)

    def connect(self, seed):
        sensor = self

        class Link:
            def batches(self):
                stamp = 10**18 + np.arange(200) * 2_000_000
                random = np.random.default_rng(seed)
                values = np.column_stack([1.4 + 0.05 * random.standard_normal(200), np.full(200, 0.012)])
                batch = Batch("", stamp, stamp + 500_000, values)
                yield sensor.wrong(batch) if sensor.wrong else batch

        return nullcontext(Link())


def stamps(function):
    return lambda batch: replace(batch, time=function(batch.time))


DEVICES = {
    "stamps late": stamps(lambda t: t + 50_000_000),
    "stamps falling": stamps(lambda t: t[::-1]),
    "stamps equal": stamps(lambda t: t // 4_000_000 * 4_000_000),
    "stamps in us": lambda b: replace(b, time=b.time // 1000, received=b.received // 1000),
    "half the announced rate": lambda b: Batch("", b.time[::2].copy(), b.received[::2].copy(), b.values[::2].copy()),
    "received before measured": lambda b: replace(b, received=b.time - 20_000_000),
    "columns swapped": lambda b: replace(b, values=b.values[:, ::-1]),
    "mm for m": lambda b: replace(b, values=b.values * [1.0, 1e3]),
    "inf": lambda b: replace(b, values=np.where(np.arange(200)[:, None] == 7, np.inf, b.values)),
    "values a list": lambda b: replace(b, values=b.values.tolist()),
    "no seed": lambda b: replace(b, values=b.values + RANDOM.uniform(0, 1e-3)),
}


def test_a_right_sensor_is_green():
    finds_device(None)


def finds_device(wrong):
    check_device(Sensor(wrong=wrong), readings={"fz": (1.0, 2.0), "z": (0.01, 0.02)})


FINDERS = {
    "tip": (finds_tip, TIPS),
    "model": (finds_model, MODELS),
    "filter": (finds_filter, FILTERS),
    "motion": (finds_motion, MOTIONS),
    "device": (finds_device, DEVICES),
}
WORDS = {
    "tip": (
        "rises to",
        "rises to",
        "derivative of profile_area",
        "in metres",
        "rises to|in metres",
        "not monotone",
        "depth 0 m",
        "not monotone|negative",
        "raises at depth|is inf",
        "jumps by",
        "validity",
        "on an array",
    ),
    "model": (
        "pressed faster",
        "when leaving",
        "viscosity has no effect",
        "not monotone",
        "is nan",
        "on an array",
        "infinitely stiff",
        "whose role is",
        "whose role is",
        "extra has no effect",
        "jumps by 1",
        "gradient of elasticity by elasticity",
        "1 numbers for 2",
        "delay_shift",
        "unit 'Paa'",
        "the start of elasticity",
        "two parameters of one name",
        "2 numbers for 1 states",
    ),
    "filter": (
        "cut into blocks",
        "cut into blocks",
        "cut into blocks",
        "out of contact",
        "second run",
        "has shape",
        "no number and no status",
        "Cramer-Rao",
        "Cramer-Rao",
        "Cramer-Rao",
        "elasticity is off by",
        "elasticity is off by",
        "below 0",
        "is off by",
        "NIS is",
        "above the estimated surface",
        "times of its estimates",
        "right sign",
        "writes into the force",
        "falls behind",
    ),
    "motion": (
        "below the skin, not 4 mm",
        "starts 1 mm inside",
        "ends 4 mm inside",
        "below the skin, not 4 mm|jumps",
        "moves at",
        "not finite",
        "below the skin|velocity",
        "goes 3 mm",
        "start and end at rest",
    ),
    "device": (
        "after it was received",
        "fall or repeat",
        "fall or repeat",
        "nanoseconds have",
        "250 Hz, announced",
        "after it was received",
        "expected 1 to 2",
        "expected 0.01",
        "infinite",
        "is a list",
        "same seed",
    ),
}
CASES = [(kind, name) for kind, (_, wrong) in FINDERS.items() for name in wrong]


def test_there_are_seventy():
    assert {kind: len(wrong) for kind, (_, wrong) in FINDERS.items()} == {
        "tip": 12,
        "model": 18,
        "filter": 20,
        "motion": 9,
        "device": 11,
    }


@pytest.mark.parametrize(
    ("kind", "name"), [pytest.param(*case, marks=[pytest.mark.slow] * (case[0] == "filter")) for case in CASES]
)
def test_a_wrong_part_is_found(kind, name):
    find, wrong = FINDERS[kind]
    words = dict(zip(wrong, WORDS[kind], strict=True))
    with pytest.raises(AssertionError, match=words[name]):
        find(wrong[name])


SHIPPED = {**palpate_estimators(), **palpate_fits()}


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_estimators_find_the_truth(name):
    check_estimator(import_target(SHIPPED[name])(), MODEL, TRUTH, truth=True)


@pytest.mark.slow
def test_the_filter_behind_the_mistakes_is_right():
    check_estimator(Wrong(), MODEL, TRUTH, truth=True)
