"""``palpate calibrate teach``: a hand leads the twin's arm; what is found against what the twin knows."""

import json
import tomllib

import numpy as np
import pytest
import typer
from palpate import ConfigurationError, DeviceError, clock
from palpate_arms.arm_by_hand import Posture
from palpate_devices.teach.pipeline_edit import edited_text
from palpate_devices.teach.surface_plane import SurfacePlane, check_fourth, work_frame
from palpate_devices.teach.teach_command import _surface
from palpate_devices.teach.tip_pivot import check_tip, pivot_of
from palpate_engine.cli import call
from palpate_kit.kinematics.rotations import matrix_of, rotation_matrix, rotation_vector

from tests.devices.simulated_bench import PIPELINE

OUT = np.array([0.0, 0.0, 1.0])
TRIANGLE = np.array([[0.0, 0.0, 0.1], [0.04, 0.0, 0.1], [0.0, 0.04, 0.1]])
PLACES = {  # where a hand leads the tip, by the words of the prompt: place [mm] and rotation vector of the tool [deg]
    "tool down": "0 0 60 0 0 0",
    "tool level;": "0 0 60 -90 0 0",
    "turned about": "0 0 60 0 -90 0",
    "half way": "0 0 60 -45 0 0",
    "straight": "0 0 5 0 0 0",
    "forwards": "0 0 5 10 0 0",
    "backwards": "0 0 5 -10 0 0",
    "left": "0 0 5 0 10 0",
    "right": "0 0 5 0 -10 0",
    "first point": "-20 -20 0.3 0 0 0",
    "second one": "20 -20 0.3 0 0 0",
    "third one": "0 25 0.3 0 0 0",
    "fourth": "2 1 0.3 0 0 0",
}


@pytest.fixture
def teach(simulated, monkeypatch, tmp_path):
    """Go through `palpate calibrate teach` with a hand at a twin in simulated time; the pipeline file afterwards."""

    def gone_through(*words, rig=(), faults=(), **places):
        where = PLACES | {key.replace("_", " "): value for key, value in places.items()}
        twin = simulated("twin.bench.height=20 mm", *rig)

        for line in faults:
            twin.fault(line)

        def prompt(text, **_):
            place = next(line for key, line in where.items() if key in text)
            if not twin.world.controller.is_free:
                twin.fault("freedrive")
            twin.fault(f"lead {place}")
            while twin.world.controller.arm.moving:
                clock().sleep(0.05)
            twin.fault("freedrive")

        monkeypatch.setattr(typer, "prompt", prompt)
        file = tmp_path / "rig.toml"
        file.write_text(PIPELINE.read_text())
        call(["calibrate", "teach", str(file), *words])
        return tomllib.loads(file.read_text())["device"]["arm"], file

    return gone_through


def millimetres(texts):
    return np.array([float(text.removesuffix(" mm")) for text in texts])


@pytest.mark.gate
@pytest.mark.slow
def test_the_surface_is_found_and_written(teach):
    arm, file = teach("--step", "surface")
    assert millimetres(arm["work"]["origin"]) == pytest.approx([-298.0, -129.0, 100.3], abs=0.05)
    assert [float(text.removesuffix(" deg")) for text in arm["work"]["rotation"]] == pytest.approx([0, 0, 0], abs=0.05)
    assert "# origin on the skin, z outwards" in file.read_text()
    assert (file.parent / "rig.toml.before").read_text() == PIPELINE.read_text()


@pytest.mark.slow
def test_a_surface_that_is_tilted_and_turned(teach):
    frame = 'twin.bench.work.rotation=["-6 deg", "3 deg", "0 deg"]', "twin.bench.work.turn=10 deg"
    arm, _ = teach("--step", "surface", rig=frame)
    normal = rotation_matrix(np.radians([float(t.removesuffix(" deg")) for t in arm["work"]["rotation"]]).tolist())[
        :, 2
    ]
    truth = rotation_matrix(np.radians([-6.0, 3.0, 0.0]).tolist())[:, 2]
    assert np.degrees(np.arccos(normal @ truth)) < 0.05
    assert float(arm["work"]["turn"].removesuffix(" deg")) == pytest.approx(10.0, abs=0.5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("places", "words"),
    [
        ({"third_one": "60 -20 0.3 0 0 0"}, "the three points lie on one line, or nearly so"),
        ({"fourth": "2 1 2.3 0 0 0"}, r"the fourth point contradicts the first three: it lies 2.0\d mm above"),
        ({"fourth": "-20 -18 0.3 0 0 0"}, "from one of the first three and shows nothing"),
    ],
    ids=["line", "contradiction", "same"],
)
def test_points_that_contradict_are_named_and_nothing_is_written(teach, tmp_path, places, words):
    with pytest.raises(ConfigurationError, match=words):
        teach("--step", "surface", **places)
    assert [path.name for path in tmp_path.iterdir()] == ["rig.toml"]
    assert (tmp_path / "rig.toml").read_text() == PIPELINE.read_text()


@pytest.mark.slow
def test_payload_and_tip_are_found(teach, capsys):
    """The tip of the pipeline is a ball of 5 mm, in a hole: the hand turns the tool about its centre."""
    tip = {key: f"{5 * s:.3f} {5 * t:.3f} {10 - 5 * np.cos(np.radians(10)):.3f} {turn}" for key, s, t, turn in (
        ("forwards", 0.0, np.sin(np.radians(10)), "10 0 0"), ("backwards", 0.0, -np.sin(np.radians(10)), "-10 0 0"),
        ("left", np.sin(np.radians(10)), 0.0, "0 10 0"), ("right", -np.sin(np.radians(10)), 0.0, "0 -10 0"),
    )}  # fmt: skip
    rig = "twin.bench.payload=620 g", 'twin.bench.payload_centre=["2 mm", "-3 mm", "55 mm"]'
    arm, _ = teach("--step", "payload", "--step", "tip", "--json", rig=rig, **tip)
    assert arm["payload"] == "620 g"
    assert arm["payload_centre"] == ["2 mm", "-3 mm", "55 mm"]
    assert json.loads(capsys.readouterr().out)["tip_off"] < 0.5e-3


@pytest.mark.slow
def test_a_tip_that_is_elsewhere_is_named(teach):
    with pytest.raises(ConfigurationError, match=r"5.0 mm from where tcp has the tip.*tcp = \["):
        teach("--step", "tip")  # turned about the end of the ball, and not about its centre


@pytest.mark.slow
def test_a_pendant_with_another_tool_is_refused(teach):
    with pytest.raises(ConfigurationError, match=r"the TCP on the pendant is at .* set the pendant's to that"):
        teach("--step", "surface", "--set", 'device.arm.tcp=["0 mm", "0 mm", "90 mm"]')


@pytest.mark.slow
def test_local_control_is_no_obstacle_but_a_safety_stop_is(teach):
    teach("--step", "surface", faults=("local",))
    with pytest.raises(DeviceError, match="safety status is PROTECTIVE_STOP"):
        teach("--step", "surface", faults=("protective-stop",))


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("--step", "surfaces"), "did you mean 'surface'"),
        (("--tolerance", "1 N"), "is not a length"),
        (("--tolerance", "0 mm"), "from above 0 up to 10 mm"),
        (("--out", "{file}"), "exists already"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_connects(words, complaint):
    with pytest.raises(ConfigurationError, match=complaint):
        call(["calibrate", "teach", str(PIPELINE), *(word.format(file=PIPELINE) for word in words)])


def test_a_pipeline_without_a_robot(root):
    with pytest.raises(ConfigurationError, match="expected one robot, not 0"):
        call(["calibrate", "teach", str(root / "pipelines" / "point.toml")])


@pytest.mark.parametrize("tilt", [(0.0, 0.0, 0.0), (10.0, -20.0, 0.0), (180.0, 0.0, 0.0)])
def test_a_frame_looks_out_of_its_plane(tilt):
    rotation = rotation_matrix(np.radians(tilt).tolist())
    points = TRIANGLE @ rotation.T
    plane = SurfacePlane.through(points, rotation @ OUT)
    tool = rotation @ np.diag([1.0, -1.0, -1.0])
    frame, off = work_frame(plane, points.mean(axis=0), tool)
    assert frame.matrix[:3, 2] == pytest.approx(rotation @ OUT, abs=1e-9)
    assert off < 1e-6
    assert frame.tool[:, 2] == pytest.approx(tool[:, 2], abs=1e-9)
    assert float(np.linalg.norm(rotation_vector(frame.tool.T @ tool))) < 1e-6
    assert check_fourth(plane, points, points.mean(axis=0), 1e-4) == pytest.approx(0.0, abs=1e-12)


def test_a_place_that_rounds_to_zero_is_written_without_a_sign():
    tip = np.eye(4)
    tip[:3, :3] = np.diag([1.0, -1.0, -1.0])
    postures = []
    for x, y in ((0.04, 0.0), (0.0, 0.04), (-0.04, 0.0), (-1e-7, -1e-7)):
        tip[:3, 3] = x, y, 0.0
        postures.append(Posture(tip.copy(), tip.copy()))
    _, work = _surface(postures, 0.5e-3)
    assert work["origin"] == ["0.00 mm"] * 3
    assert not any(text.startswith("-0.00") for text in (*work["rotation"], work["turn"]))


def test_points_on_a_line_and_a_fourth_beside_the_plane_are_refused():
    with pytest.raises(
        ConfigurationError, match=r"one of them is 2.0 mm from the line of the others, and at least 5.0"
    ):
        SurfacePlane.through(np.array([[0, 0, 0], [0.02, 0.002, 0], [0.04, 0, 0]]), OUT)
    plane = SurfacePlane.through(TRIANGLE, OUT)
    with pytest.raises(ConfigurationError, match=r"0.60 mm below their plane, over --tolerance 0.5 mm"):
        check_fourth(plane, TRIANGLE, np.array([0.02, 0.01, 0.0994]), 0.5e-3)
    with pytest.raises(ConfigurationError, match=r"4.0 mm from one of the first three"):
        check_fourth(plane, TRIANGLE, np.array([0.004, 0.0, 0.1]), 0.5e-3)


def test_a_plane_that_the_tool_does_not_look_at_is_refused():
    with pytest.raises(ConfigurationError, match="tilted by 60 deg from the tool"):
        SurfacePlane.through(TRIANGLE, rotation_matrix((np.pi / 3, 0.0, 0.0)) @ OUT)


TOOL = matrix_of([1e-3, -2e-3, 0.12, 0.0, 0.0, 0.0])


def turned(turns, noise=0.0, seed=0):
    """Flanges of a tool that is turned about its tip, which slips by a noise [m]."""
    random = np.random.default_rng(seed)
    found = []
    for turn in turns:
        tip = matrix_of([0.3, 0.1, 0.2, *np.radians(turn).tolist()])
        tip[:3, 3] += noise * random.standard_normal(3)
        found.append(tip @ np.linalg.inv(TOOL))
    return found


CROSS = [(180, 0, 0), (170, 0, 0), (190, 0, 0), (180, 10, 0), (180, -10, 0)]


def test_the_tip_is_where_the_tool_turned_about():
    pivot = pivot_of(turned(CROSS))
    assert pivot.place == pytest.approx(TOOL[:3, 3], abs=1e-9)
    assert check_tip(pivot, TOOL, 0.0) < 1e-9
    inside = [abs(pivot_of(turned(CROSS, 2e-5, seed)).place - TOOL[:3, 3]).max() for seed in range(20)]
    stds = [pivot_of(turned(CROSS, 2e-5, seed)).std for seed in range(20)]
    assert np.mean(inside) < 2 * np.mean(stds)


@pytest.mark.parametrize(
    ("flanges", "words"),
    [
        (turned([(180, 0, 0), (179, 0, 0), (181, 0, 0), (180, 1, 0)]), "shows too little"),
        (turned([(180, 0, 0), (170, 0, 0), (190, 0, 0), (165, 0, 0)]), "all turns were about one axis"),
        (turned(CROSS, 3e-3), "the tip slid by"),
    ],
)
def test_turns_that_show_no_tip_are_refused(flanges, words):
    with pytest.raises(ConfigurationError, match=words):
        check_tip(pivot_of(flanges), TOOL, 0.0)


def test_a_table_that_is_not_there_is_made_and_the_rest_stays():
    text = '# a rig\n[device.arm]\ntype = "ur"  # an arm\nwork = { origin = ["1 m", "0 m", "0 m"] }\n[safety]\n'
    found = edited_text(text, "arm", {"work": {"origin": ["2 m", "0 m", "0 m"]}, "payload": "1 kg"})
    assert tomllib.loads(found)["device"]["arm"]["work"]["origin"][0] == "2 m"
    assert "# an arm" in found
    assert "[safety]" in found
    with pytest.raises(ConfigurationError, match=r"\[device.leg\] cannot be written"):
        edited_text(text, "leg", {})
