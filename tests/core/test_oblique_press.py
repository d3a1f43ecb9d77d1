"""A tool that stands upright and presses straight down beside the apex of a dome, against spheres that touch.

Two spheres touch on the line of their centres: with L = R + r, the dome's and the tip's radius, the depth of a centre
at the distance D is L - D and the normal is along D. On it acts Hertz's force of the radius 1/(1/R + 1/r) with its
viscous part (Johnson 1985, section 4.2); whatever friction adds is across it. None of this asks a surface.
"""

import math

import numpy as np
import pytest
from palpate import Batch
from palpate.errors import ConfigurationError
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline.tracks import start_tracks
from palpate_kit.kinematics.rotations import quaternion

DOME, TIP, ELASTICITY, VISCOSITY, MASS, GRAVITY = 0.04, 0.005, 60e3, 180.0, 0.14, 9.80665
PIPELINE = """
[surface.dome]
type = "half-ellipsoid"
half_axes = ["40 mm", "40 mm", "40 mm"]
[device.rig]
type = "sim"
specimen = {{ model = "dr", elasticity = "60 kPa", viscosity = "180 Pa*s" }}
[trajectory.press]
type = "point"
bias = "4 mm"
[alignment]
{along}
weight = "turning"
tare = "none"
force = {{ channel = "rig.wrench.z", uncertainty = "0.1 ms" }}
position = "rig.tip.z"
velocity = {{ channel = "rig.twist.z", uncertainty = "0.1 ms" }}
tip_mass = "140 g"
[indenter.tip]
{tip}
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
thickness = "half-space"
[estimator.fit]
type = "casadi-fit"
"""
SURFACE, SPHERE = 'surface = "dome"', 'type = "sphere"\nradius = "5 mm"'
UPRIGHT = np.diag([1.0, -1.0, -1.0])  # the tool in the work frame; the sensor's z looks out of the skin


def loaded(tmp_path, along=SURFACE, tip=SPHERE):
    (tmp_path / "press.toml").write_text(PIPELINE.format(along=along, tip=tip))
    return load_pipeline(tmp_path / "press.toml")


def dome(centre, velocity):
    """Depth, its rate and outward normals (n, 3) of centres (n, 3) of a tip that touches the dome, from its apex."""
    arm = centre + np.array([0.0, 0.0, DOME])
    distance = np.linalg.norm(arm, axis=1)
    normal = arm / distance[:, None]
    return DOME + TIP - distance, -np.sum(normal * velocity, axis=1), normal


def press(angle, friction, rock=0.0, seed=0, rates=(800.0, 500.0)):
    """Batches of a sine of 1 mm at 3 mm below first touch, `angle` [rad] beside the apex; the tool may rock about y."""

    def motion(t):
        sine, cosine = np.sin(4.0 * math.pi * t), 4.0 * math.pi * np.cos(4.0 * math.pi * t)
        s = np.clip((t - 0.4) / 0.4, 0.0, 1.0)
        pressed, going = s**3 * (10.0 - 15.0 * s + 6.0 * s * s), 30.0 * s * s * (1.0 - s) ** 2 / 0.4
        beside = DOME * math.sin(angle)
        touch = math.sqrt((DOME + TIP) ** 2 - beside**2) - DOME
        z = touch + 5e-3 - (8e-3 - 1e-3 * sine) * pressed
        speed = 1e-3 * cosine * pressed - (8e-3 - 1e-3 * sine) * going
        centre = np.column_stack([np.full(len(t), beside), np.zeros(len(t)), z])
        turn = rock * np.cos(3.0 * math.pi * t)
        moved = np.column_stack([np.zeros((len(t), 2)), speed])
        return centre, moved, turn, -rock * 3.0 * math.pi * np.sin(3.0 * math.pi * t)

    def about_y(turn):
        c, s, zero = np.cos(turn), np.sin(turn), np.zeros(len(turn))
        rows = [[c, zero, s], [zero, zero + 1.0, zero], [-s, zero, c]]
        return np.moveaxis(np.array(rows), 2, 0)

    at_force, at_pose = (np.rint(np.arange(round(rate * 4.0)) / rate * 1e9).astype(np.int64) for rate in rates)
    centre, velocity, turn, _ = motion(at_force / 1e9)
    depth, rate, normal = dome(centre, velocity)
    deep, radius = np.maximum(depth, 0.0), 1.0 / (1.0 / DOME + 1.0 / TIP)
    push = 4.0 / 3.0 * ELASTICITY / 0.75 * math.sqrt(radius) * deep**1.5
    push = np.maximum(push + 4.0 * VISCOSITY / 0.5 * np.sqrt(radius * deep) * rate, 0.0)
    aside = velocity - np.sum(velocity * normal, axis=1)[:, None] * normal
    speed = np.maximum(np.linalg.norm(aside, axis=1), 1e-3)
    felt = push[:, None] * (normal - friction * aside / speed[:, None])
    felt[:, 2] -= MASS * (GRAVITY + np.gradient(velocity[:, 2], at_force / 1e9))
    wrench = np.einsum("nij,ni->nj", about_y(turn), felt) + 0.02 * np.random.default_rng(seed).standard_normal(
        felt.shape
    )
    centre, velocity, turn, spin = motion(at_pose / 1e9)
    out = about_y(turn)[:, :, 2]  # the tool's end is below the centre, along its axis
    about = np.column_stack([np.zeros(len(spin)), spin, np.zeros(len(spin))])
    end = np.hstack([centre - TIP * out, [quaternion(m @ UPRIGHT) for m in about_y(turn)]])
    twist = np.hstack([velocity - TIP * np.cross(about, out), about])
    streams = {"wrench": (at_force, wrench), "tip": (at_pose, end), "twist": (at_pose, twist)}
    return [Batch(name, time, time, values) for name, (time, values) in streams.items()]


def estimated(pipeline, batches):
    """E [Pa] and eta [Pa s], the alignment's report and the samples."""
    aligner = pipeline.new_aligner()
    samples = aligner.aligned([("rig", batch) for batch in batches], final=True)
    (track,) = start_tracks(pipeline)
    track.run(samples)
    track.run(aligner.samples(final=True))
    values = track.result(aligner.report, pipeline.alignment, 1.0).parameters
    return values["elasticity"].value, values["viscosity"].value, aligner.report, samples


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("degrees", [0.0, 17.5, 30.0, 45.0])
def test_a_sphere_pressed_straight_down_beside_the_apex_of_a_dome_finds_the_material(tmp_path, degrees, friction):
    """With normal and depth of the tip's end E was 1.5, 5.0 and 12 % too high."""
    batches = press(math.radians(degrees), friction)
    elasticity, viscosity, report, samples = estimated(loaded(tmp_path), batches)
    assert elasticity == pytest.approx(ELASTICITY, rel=6e-3)
    assert viscosity == pytest.approx(VISCOSITY, rel=1e-2)
    centre = batches[1].values[:, :3] + np.array([0.0, 0.0, TIP])
    depth, rate, normal = dome(centre, batches[2].values[:, :3])
    assert report.turned.tilt == pytest.approx(
        math.acos(np.quantile(normal[depth > 0.0, 2], 0.01)), abs=math.radians(0.2)
    )
    rows = depth[: len(samples)] > 0.0
    assert np.allclose(samples.position[rows], -depth[: len(samples)][rows], atol=2e-7)
    assert np.allclose(samples.velocity[rows], -rate[: len(samples)][rows], atol=2e-5)


def test_a_tool_that_rocks_about_its_end_changes_nothing(tmp_path):
    """By 12 degrees to each side, 1.5 times a second: the end goes 1 mm aside, the centre straight up and down."""
    elasticity, viscosity, *_ = estimated(loaded(tmp_path), press(math.radians(30.0), 0.3, math.radians(12.0)))
    assert elasticity == pytest.approx(ELASTICITY, rel=6e-3)
    assert viscosity == pytest.approx(VISCOSITY, rel=1e-2)


def test_the_height_over_a_stated_plane_is_that_of_the_sphere(tmp_path):
    tilt = math.radians(20.0)
    batches = press(0.0, 0.0)
    normal = np.array([-math.sin(tilt), 0.0, math.cos(tilt)])
    _, _, report, samples = estimated(loaded(tmp_path, f"normal = {normal.tolist()}"), batches)
    centre = batches[1].values[: len(samples), :3] + np.array([0.0, 0.0, TIP])
    assert np.allclose(samples.position, centre @ normal - TIP, atol=1e-12)
    assert report.turned.tilt == pytest.approx(tilt, abs=math.radians(0.1))


def test_spheres_of_two_sizes_along_one_normal_are_refused(tmp_path):
    two = SPHERE + '\n[indenter.other]\ntype = "exact-sphere"\nradius = "4 mm"'
    other = '\n[model.other]\ntype = "dimensionality-reduction"\nindenter = "other"\n'
    (tmp_path / "two.toml").write_text(PIPELINE.format(along=SURFACE, tip=two) + other)
    with pytest.raises(
        ConfigurationError, match="surface: is that under one tip, and the models have spheres of 4 and 5"
    ):
        load_pipeline(tmp_path / "two.toml")
