"""A tool that turns: its weight is taken off by its orientation, and force and motion are those along the normal."""

import math

import numpy as np
import pytest
from palpate import Batch, Channel, Stream, Surface, SurfacePoints
from palpate.errors import ConfigurationError
from palpate_engine.alignment import Aligner, AlignmentSettings, Ports
from palpate_engine.config import load_pipeline
from palpate_engine.result.record_flags import alignment_flags
from palpate_kit.kinematics.rotations import quaternion, rotation_matrix

MASS, GRAVITY, BIAS = 0.14, 9.80665, np.array([0.4, -0.3, 0.6])
LOOKS_AT_SKIN = np.diag([1.0, -1.0, -1.0])
HALF = (math.pi, 0.0, 0.0)
AXES = "xyz"
WRENCH = Stream("wrench", tuple(Channel(axis, "N", (-500.0, 500.0)) for axis in AXES), 800.0)
POSE = Stream("tip", (*(Channel(a, "m") for a in AXES), *(Channel(f"q{a}", "1") for a in "xyzw")), 500.0, "pose")
TWIST = Stream(
    "twist", (*(Channel(a, "m/s") for a in AXES), *(Channel(f"w{a}", "rad/s") for a in AXES)), 500.0, "twist"
)
RIG = {"rig": (WRENCH, POSE, TWIST)}


SURE = {"mounting_uncertainty": "0.5 deg", "tip_mass_uncertainty": "1 g"}


def settings(**changes):
    table = {"force": "rig.wrench.z", "position": "rig.tip.z", "velocity": "rig.twist.z", "tare": "none"}
    return AlignmentSettings.model_validate({"tip_mass": MASS, "bias": BIAS.tolist(), **table, **changes})


def stamps(rate, duration):
    return np.rint(np.arange(round(rate * duration)) / rate * 1e9).astype(np.int64)


def record(turn, push=lambda t: np.zeros((len(t), 3)), place=None, mounting=HALF, reaction=1, duration=2.0, noise=0.0):
    """Batches of a tool that is turned about its y by `turn` [rad] of the time [s], pushed by a force (n, 3) [N]."""
    force, motion = stamps(800.0, duration), stamps(500.0, duration)
    place = place or (lambda t: np.zeros((len(t), 3)))
    own = np.array(
        [LOOKS_AT_SKIN @ rotation_matrix((0.0, a, 0.0)) @ rotation_matrix(mounting) for a in turn(force / 1e9)]
    )
    felt = push(force / 1e9) + MASS * GRAVITY * np.array([0.0, 0.0, -1.0])
    wrench = reaction * np.einsum("nij,ni->nj", own, felt) + BIAS
    wrench += noise * np.random.default_rng(1).standard_normal(wrench.shape)
    tools = np.array([quaternion(LOOKS_AT_SKIN @ rotation_matrix((0.0, a, 0.0))) for a in turn(motion / 1e9)])
    path = place(motion / 1e9)
    speed = np.gradient(path, motion / 1e9, axis=0)
    return [
        Batch("wrench", force, force, wrench),
        Batch("tip", motion, motion, np.hstack([path, tools])),
        Batch("twist", motion, motion, np.hstack([speed, np.zeros_like(speed)])),
    ]


def aligned(batches, streams=RIG, **changes):
    made = settings(**changes)
    aligner = Aligner(made, Ports.of(made, streams))
    for batch in batches:
        aligner.feed("rig", batch)
    return aligner.samples(final=True), aligner.report, made


def tilting(t):
    """Level, then 20 degrees, in a second."""
    return math.radians(20.0) * np.clip(t - 0.5, 0.0, 1.0)


def test_the_weight_of_a_tool_that_turns_is_felt_along_and_across_it():
    """m g (1 - cos 20 deg) = 0.083 N and m g sin 20 deg = 0.470 N of 140 g; nothing is left where it is taken off."""
    batches = record(tilting)
    tared, *_ = aligned(batches)
    own = batches[0].values - BIAS
    along, across = tared.force - BIAS[2] + MASS * GRAVITY, np.hypot(own[:, 0], own[:, 1])
    assert along[-1] == pytest.approx(0.0828, abs=1e-4)
    assert across[-1] == pytest.approx(0.4696, abs=1e-4)
    free, *_ = aligned(batches, weight="turning")
    assert np.nanmax(np.abs(free.force)) < 2e-6  # which is what interpolation between two readings leaves


@pytest.mark.parametrize(
    ("mounting", "sign", "reaction", "stated"),
    [
        (HALF, 1, 1, False),
        ((0.0, 0.0, 0.0), -1, 1, False),
        ((0.0, 0.0, 0.0), 1, -1, True),
        (HALF, -1, -1, True),
        ((2.9, 0.9, 0.3), 1, 1, True),
        ((0.3, -0.2, 2.0), 1, -1, True),
    ],
)
@pytest.mark.parametrize("normal", [None, (0.0, 0.0, 1.0), (-math.sin(0.2), 0.1, math.cos(0.2))])
def test_every_mounting_and_convention_gives_the_force_that_pushes_the_tip_out(
    mounting, sign, reaction, stated, normal
):
    force = np.array([0.3, -0.5, 2.0])
    batches = record(tilting, lambda t: np.broadcast_to(force, (len(t), 3)), mounting=mounting, reaction=reaction)
    changes = {"mounting": mounting} if stated else {}
    if normal is not None:
        changes["normal"] = normal
    samples, *_ = aligned(batches, weight="turning", force={"channel": "rig.wrench.z", "sign": sign}, **changes)
    if normal is None:
        sensor = LOOKS_AT_SKIN @ rotation_matrix((0.0, tilting(np.array([1.99]))[0], 0.0)) @ rotation_matrix(mounting)
        wanted = sign * reaction * force @ sensor[:, 2]
    else:
        wanted = force @ normal / np.linalg.norm(normal)
    assert samples.force[-5] == pytest.approx(wanted, abs=1e-5)


def test_height_and_velocity_are_those_along_the_normal():
    normal = np.array([-math.sin(0.3), 0.0, math.cos(0.3)])

    def place(t):
        return np.outer(0.01 - 0.002 * np.sin(3.0 * t), normal) + np.outer(
            0.05 * t, [math.cos(0.3), 0.0, math.sin(0.3)]
        )

    batches = record(lambda t: 0.3 + 0.0 * t, place=place)
    for velocity in ("rig.twist.z", None):
        samples, *_ = aligned(batches, normal=normal.tolist(), weight="turning", velocity=velocity)
        assert np.allclose(samples.position, 0.01 - 0.002 * np.sin(3.0 * samples.time), atol=1e-12)
        inner = slice(2, -2)
        assert np.allclose(samples.velocity[inner], -0.006 * np.cos(3.0 * samples.time)[inner], atol=2e-7)
        assert np.allclose(samples.lateral, place(samples.time)[:, :2]) or np.isnan(samples.lateral).all()


def test_samples_and_findings_do_not_depend_on_how_a_record_is_cut():
    def push(t):
        return np.outer(np.clip(t - 1.2, 0.0, None) * 10.0, [0.1, 0.0, 1.0])

    batches = record(tilting, push, noise=0.05)
    changes = {"weight": "turning", "normal": [-0.1, 0.0, 1.0], "tare": "free-air"}
    whole, report, _ = aligned(batches, **changes)
    made = settings(**changes)
    aligner, parts = Aligner(made, Ports.of(made, RIG)), []
    for begin in range(0, 2000, 37):
        for batch in batches:
            rows = (batch.time >= begin * 1e6) & (batch.time < (begin + 37) * 1e6)
            piece = Batch(batch.stream, batch.time[rows], batch.received[rows], batch.values[rows])
            parts.append(aligner.aligned([("rig", piece)]))
    parts.append(aligner.samples(final=True))
    force = np.concatenate([part.force for part in parts])
    assert np.array_equal(force, whole.force, equal_nan=True)
    assert aligner.report.turned == report.turned
    assert aligner.report.sideways == report.sideways
    assert report.turned.turn > 0.1


@pytest.mark.parametrize(
    ("changes", "codes"),
    [
        ({}, []),
        ({"tip_mass": 0.145}, []),
        ({"tip_mass": 0.28}, ["turned-weight"]),
        ({"mounting": (0.0, math.pi, 0.0)}, ["turned-weight"]),
        ({**SURE, "mounting": (math.pi * math.cos(0.1), math.pi * math.sin(0.1), 0.0)}, ["turned-weight"]),
        (SURE, []),
        ({"mounting": (3.1, 0.01, 0.02)}, []),
        ({"gravity": (0.0, 1.0, -1.0)}, ["turned-weight"]),
    ],
)
def test_a_weight_that_the_readings_do_not_follow_is_told(changes, codes):
    """A sensor of another mounting by a half turn or 11 degrees about the tool, another mass, another gravity."""
    _, report, made = aligned(record(tilting, noise=0.05, duration=3.0), weight="turning", tare="free-air", **changes)
    assert [flag.code for flag in alignment_flags(report, made) if flag.code == "turned-weight"] == codes


@pytest.mark.parametrize(("weight", "codes"), [("tared", ["turned-tool"]), ("turning", [])])
def test_a_tool_that_turns_under_a_constant_tare_is_told(weight, codes):
    _, report, made = aligned(record(tilting, noise=0.05), weight=weight)
    assert [flag.code for flag in alignment_flags(report, made) if flag.code.startswith("turned")] == codes
    _, report, made = aligned(record(lambda t: 0.1 + 0.03 * t, noise=0.05), weight=weight)  # by 3 degrees: 11 mN
    assert not [flag.code for flag in alignment_flags(report, made) if flag.code.startswith("turned")]


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("alignment.position=rig.setpoint.z", "rig.setpoint.z is of no pose"),
        ("alignment.force=rig.wrench.x", "mounting: is needed where the force is the sensor's x"),
        ('alignment.mounting=["90 deg", "0 deg", "0 deg"]', "mounting: puts rig.wrench.z 90 deg off"),
        ("alignment.normal=[0, 0, 0]", "must be a direction"),
    ],
)
def test_orientations_that_cannot_be_used_are_refused(root, override, words):
    with pytest.raises(ConfigurationError, match=words):
        load_pipeline(root / "pipelines" / "point.toml", ["alignment.weight=turning", override])


def test_a_weight_needs_a_mass_and_an_inclination_counts_once(root, tmp_path):
    text = (root / "pipelines" / "point.toml").read_text()
    (tmp_path / "a.toml").write_text(text.replace('tip_mass = "140 g"\n\n[indenter', 'weight = "turning"\n\n[indenter'))
    with pytest.raises(ConfigurationError, match="tip_mass: is needed for weight"):
        load_pipeline(tmp_path / "a.toml")
    twice = ["alignment.normal=[0, 0.1, 1]", 'model.dr.skin={ inclination = "6 deg" }']
    with pytest.raises(ConfigurationError, match="counts the inclination once more"):
        load_pipeline(root / "pipelines" / "point.toml", twice)


def test_gravity_is_that_of_the_arm_where_none_is_stated(root):
    oriented = ["alignment.weight=turning", "device.rig.down=[0.6, 0, -0.8]"]
    path = root / "pipelines" / "point.toml"
    assert load_pipeline(path, oriented).alignment.gravity == (0.6, 0.0, -0.8)
    assert load_pipeline(path, [*oriented, "alignment.gravity=[1, 0, 0]"]).alignment.gravity == (1.0, 0.0, 0.0)
    assert load_pipeline(path, oriented[1:]).alignment.gravity is None


class Ball(Surface):
    """A sphere of 50 mm, unknown on one side."""

    def nearest(self, places):
        """On the radius through each place."""
        distance = np.linalg.norm(places, axis=1)
        normal, zero, flat = places / distance[:, None], np.zeros(len(places)), np.zeros((len(places), 2))
        unknown = {int(row): "never touched" for row in np.flatnonzero(places[:, 0] > 0.03)}
        curvature = np.tile([22.0, 18.0], (len(places), 1))
        return SurfacePoints(0.05 * normal, normal, distance - 0.05, curvature, zero, zero, flat + 0.5, unknown)

    def uppermost(self, lateral):
        """Not asked for."""
        raise NotImplementedError


def round_the_ball(duration=2.0):
    """A tool that goes round a ball at 1 mm below its surface, from top to 40 degrees, pushed out by 2 N."""

    def normal(t):
        angle = math.radians(20.0) * t
        return np.column_stack([np.sin(angle), np.zeros(len(t)), np.cos(angle)])

    return record(
        lambda t: -math.radians(20.0) * t, lambda t: 2.0 * normal(t), lambda t: 0.049 * normal(t), duration=duration
    )


def test_force_and_height_are_those_along_the_normal_at_each_place():
    samples, report, _ = aligned(round_the_ball(), weight="turning", surface=Ball())
    edge = math.degrees(math.asin(0.03 / 0.049)) / 20.0
    known, unknown = samples.time < edge, samples.time > edge + 50e-6 / 0.017  # a plane reaches 50 um
    assert np.allclose(samples.position[known], -0.001, atol=3e-8)  # the sag of a ball of 50 mm over 50 um
    assert np.allclose(samples.force[known], 2.0, atol=1e-5)
    assert np.nanmax(np.abs(samples.velocity[known][1:])) < 2e-5  # of 17 mm/s along the skin
    assert np.isnan(samples.force[unknown]).all()
    assert (samples.curvature[known] == [22.0, 18.0]).all()
    assert np.isnan(samples.curvature[unknown]).all()
    assert (report.turned.curvature, report.turned.curvature_std) == pytest.approx((20.0, 0.5))


def test_samples_over_a_surface_do_not_depend_on_how_a_record_is_cut():
    batches, changes = round_the_ball(), {"weight": "turning", "surface": Ball(), "velocity": None}
    whole, report, _ = aligned(batches, **changes)
    made = settings(**changes)
    aligner, parts = Aligner(made, Ports.of(made, RIG)), []
    for begin in range(0, 2000, 23):
        for batch in batches:
            rows = (batch.time >= begin * 1e6) & (batch.time < (begin + 23) * 1e6)
            piece = Batch(batch.stream, batch.time[rows], batch.received[rows], batch.values[rows])
            parts.append(aligner.aligned([("rig", piece)]))
    parts.append(aligner.samples(final=True))
    for key in ("force", "position", "velocity"):
        columns = np.concatenate([getattr(part, key) for part in parts])
        assert np.array_equal(columns, getattr(whole, key), equal_nan=True)
    assert aligner.report.turned == report.turned
