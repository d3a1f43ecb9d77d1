"""`palpate check motion`, `map` and its subcommands, `run resume`: from a pipeline to a picture and a list of lumps."""

import csv
import itertools
import json
import math
import re
import shutil
import signal
import time

import numpy as np
import pytest
from palpate_commands.resume import remaining_pipeline
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_maps.lump_criteria import TrackResponse
from palpate_maps.map_analysis import find_lumps, make_map, read_path, sites_along
from palpate_maps.track_response import SIGMA

from tests.processes import DEVNULL, PALPATE, PIPE, start

SMALL = (
    'trajectory.raster.size=["20 mm", "10 mm"]',
    "trajectory.raster.settle=1 s",
    "trajectory.raster.pitch=5 mm",
    "device.rig.sensor_rate=500 Hz",
    'trajectory.raster.centre=["-16 mm", "6 mm"]',
)


def options(assignments):
    return [part for assignment in assignments for part in ("--set", assignment)]


@pytest.fixture(scope="module")
def sweep_run(root, tmp_path_factory):
    """The example sweep, run once."""
    folder = tmp_path_factory.mktemp("sweep") / "run"
    run_pipeline(
        load_pipeline(root / "pipelines" / "sweep.toml", ['run.tracks=["dr/smoother", "dr/ekf", "dr/afekf"]']), folder
    )
    return folder


@pytest.fixture(scope="module")
def raster_run(root, tmp_path_factory):
    """A small part of the example raster, run once."""
    folder = tmp_path_factory.mktemp("raster") / "run"
    run_pipeline(load_pipeline(root / "pipelines" / "raster.toml", SMALL), folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("map lumps", "lumps of run, after"),
        pytest.param("map", "map of run, after", marks=pytest.mark.slow),
        pytest.param("report", "report of 1 run, ", marks=pytest.mark.slow),
    ],
)
def test_ten_thousand_sites_take_their_time_and_it_is_said(palpate, raster_run, tmp_path, monkeypatch, command, said):
    monkeypatch.setattr("palpate_kit.terminal.progress._LINE_INTERVAL", 1e-3)
    done = palpate(*command.split(), shutil.copytree(raster_run, tmp_path / "run"))
    assert done.returncode == 0, done.stderr
    assert said in done.stderr


@pytest.mark.gate
@pytest.mark.slow
def test_a_sweep_gives_a_picture_and_its_lumps(palpate, sweep_run):
    done = palpate("map", sweep_run)
    assert done.returncode == 0, done.stderr
    assert (sweep_run / "maps" / "sweep.png").read_bytes().startswith(b"\x89PNG")
    rows = (sweep_run / "maps" / "sweep.csv").read_text().splitlines()
    assert rows[0] == "track,along_m,x_m,y_m,elasticity,elasticity_std"
    assert len(rows) > 130
    found = json.loads(palpate("map", "lumps", sweep_run, "--json").stdout)
    assert [lump["y"] for lump in found["lumps"]] == [pytest.approx(-0.014, abs=1e-3), pytest.approx(0.014, abs=1e-3)]
    text = palpate("map", "lumps", sweep_run).stdout
    assert "contrast" in text
    assert "kPa" in text


@pytest.mark.slow
@pytest.mark.parametrize("track", ["dr/smoother", "dr/afekf"])
def test_a_lump_of_a_sweep_is_within_its_uncertainty(palpate, sweep_run, track):
    """The AFEKF is 1 to 2 mm late: how late is known by its response, and a part of the ±."""
    found = json.loads(palpate("map", "lumps", sweep_run, "--track", track, "--json").stdout)
    assert len(found["lumps"]) == 2
    for lump, place in zip(found["lumps"], (-0.014, 0.014), strict=True):
        assert abs(lump["y"] - place) < 2 * lump["place_std"][1] < 4e-3
        assert lump["size"]["value"] < lump["extent"][0]


@pytest.mark.slow
def test_the_papers_filter_finds_no_lump_in_the_same_sweep(sweep_run):
    assert find_lumps(sites_along(read_path(sweep_run, "dr/ekf"))).lumps == ()


@pytest.mark.slow
@pytest.mark.parametrize(("track", "least"), [("dr/smoother", 0.9), ("dr/ekf", 0.0)])
def test_a_track_excludes_by_its_own_response(palpate, sweep_run, tmp_path, track, least):
    """The paper's filter follows no narrow lump: it excludes nothing, and its lumps are doubtful."""
    run = shutil.copytree(sweep_run, tmp_path / "run")
    done = palpate("map", "lumps", run, "--track", track)
    assert done.returncode == 0, done.stderr
    found = json.loads((run / "maps" / "lumps.json").read_text())
    follows = least > 0
    share = TrackResponse(**found["response"]).share(SIGMA)
    assert share > least if follows else share < 0.5
    assert bool(found["excluded"]) == follows
    assert ("does not follow the changes" in done.stderr) != follows
    page = tmp_path / "run.html"
    assert palpate("report", run, "-o", page).returncode == 0
    assert ("Nothing is excluded" in page.read_text("utf-8")) != follows


@pytest.mark.slow
def test_a_raster_gives_a_map(palpate, raster_run):
    done = palpate("map", raster_run, "--cell", "2 mm", "--svg")
    assert done.returncode == 0, done.stderr
    with np.load(raster_run / "maps" / "map.npz") as arrays:
        assert arrays["value"].shape == arrays["std"].shape == arrays["covered"].shape == (6, 11)
        peak = np.unravel_index(np.nanargmax(arrays["value"]), arrays["value"].shape)
        assert arrays["x"][peak[1]] == pytest.approx(-0.016, abs=2.1e-3)
        assert str(arrays["parameter"]) == "elasticity"
    assert (
        (raster_run / "maps" / "map.csv").read_text().startswith("x_m,y_m,elasticity,elasticity_std,covered,p,stiff\n")
    )
    assert (raster_run / "maps" / "map.svg").stat().st_size > 10_000


@pytest.mark.slow
def test_a_pipeline_file_becomes_a_map_in_one_command(palpate, root, tmp_path):
    file = tmp_path / "raster.toml"
    text = (root / "pipelines" / "raster.toml").read_text()
    text = text.replace('size = ["60 mm", "40 mm"]', 'size = ["20 mm", "10 mm"]').replace(
        'settle = "2 s"', 'settle = "1 s"'
    )
    file.write_text(text.replace("[run]", '[run]\ntracks = ["dr/kinematic"]'))
    done = palpate("map", file, "--method", "average", "--out", tmp_path / "maps")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "maps" / "map.png").read_bytes().startswith(b"\x89PNG")
    assert len(list((tmp_path / "runs").glob("*/result.json"))) == 1


@pytest.mark.slow
def test_the_log_says_where_each_estimate_is_from(raster_run):
    """The estimates of a run have a place while it goes on."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with (raster_run / "log.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        found = [m for *_, m in reader.iter_decoded_messages(topics=["/palpate/estimates/dr/kinematic"])]
    with (raster_run / "estimates.csv").open(newline="") as file:
        rows = {round(float(row["time_s"]), 3): row for row in csv.DictReader(file)}
    compared = [(m, rows[key]) for m in found if (key := round(m.time, 3)) in rows]
    assert len(compared) > 1000
    logged = np.array([(m.x, m.y) for m, _ in compared])
    written = np.array([(float(row["x_m"]), float(row["y_m"])) for _, row in compared])
    np.testing.assert_allclose(logged, written, rtol=1e-9, atol=1e-12)  # the table has ten digits


@pytest.mark.gate
@pytest.mark.slow
def test_an_interrupted_raster_resumes_at_the_last_whole_line(root, raster_run, tmp_path, palpate):
    """The first part is cut by hand to what a kill in the second line leaves."""
    cut = tmp_path / "cut"
    shutil.copytree(raster_run, cut, ignore=shutil.ignore_patterns("maps", "estimates-offline.csv", "result.json"))
    rows = (cut / "estimates.csv").read_text().splitlines(keepends=True)
    last = next(i for i, row in enumerate(rows[1:], 1) if float(row.split(",")[0]) > 12.0)
    (cut / "estimates.csv").write_text("".join(rows[:last]) + rows[last][:20])
    done = palpate("run", "resume", cut)
    assert done.returncode == 0, done.stderr
    assert "first_line = 1" in (cut / "part-2" / "pipeline.toml").read_text()
    assert "nothing is left" in palpate("run", "resume", cut).stdout
    whole, pieces = (make_map(sites_along(read_path(run)), 2e-3, "average") for run in (raster_run, cut))
    both = whole.covered[:-1, :-1] & pieces.covered[: whole.covered.shape[0] - 1, : whole.covered.shape[1] - 1]
    assert both.mean() > 0.9
    apart = (whole.value[:-1, :-1] - pieces.value[:-1, :-1])[both] / np.hypot(whole.std, pieces.std)[:-1, :-1][both]
    assert np.sqrt(np.mean(apart**2)) < 1.5


@pytest.mark.slow
def test_ctrl_c_leaves_a_raster_that_resumes(root, tmp_path):
    out = tmp_path / "out"
    words = ["--out", out, *options([*SMALL, "device.rig.pace=real-time"])]
    process = start(PALPATE, "run", root / "pipelines" / "raster.toml", *words, stdout=PIPE, stderr=PIPE, text=True)
    log, deadline = out / "log.mcap", time.monotonic() + 120
    while not (log.exists() and log.stat().st_size > 100_000) and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 130, errors
    (rest,) = remaining_pipeline(out).trajectories.values()
    assert rest.first_line == 0
    assert rest.lines == 3


@pytest.mark.slow
def test_a_killed_raster_resumes_and_gives_the_map_of_an_uninterrupted_one(palpate, root, tmp_path):
    """Killed without warning in its second line; the rest is done by `palpate run resume`."""
    small = [
        'trajectory.raster.size=["16 mm", "10 mm"]',
        "trajectory.raster.settle=1 s",
        "trajectory.raster.speed=6 mm/s",
    ]
    small += ['trajectory.raster.centre=["-16 mm", "6 mm"]', "device.rig.sensor_rate=500 Hz"]
    small += ["estimator.kinematic.sweep_speed=6 mm/s", 'run.tracks=["dr/kinematic"]']
    out, file = tmp_path / "out", root / "pipelines" / "raster.toml"
    words = ["--out", out, *options([*small, "device.rig.pace=real-time"])]
    process = start(PALPATE, "run", file, *words, stdout=DEVNULL, stderr=DEVNULL)
    first_line = next(iter(load_pipeline(file, small).trajectories.values())).total_duration / 3
    deadline = time.monotonic() + 180
    while last_time(out / "estimates.csv") < first_line + 1.5 and time.monotonic() < deadline:
        time.sleep(0.05)
    process.kill()
    process.wait()
    assert not (out / "result.json").exists()
    resolved = out / "pipeline.toml"
    resolved.write_text(resolved.read_text().replace('pace = "real-time"', 'pace = "fast"'))
    done = palpate("run", "resume", out)
    assert done.returncode == 0, done.stderr
    (rest,) = load_pipeline(out / "part-2" / "pipeline.toml").trajectories.values()
    assert rest.first_line in (1, 2)  # 2 where the machine was slow to kill it
    run_pipeline(load_pipeline(file, small), tmp_path / "whole")
    whole, pieces = (make_map(sites_along(read_path(run)), 2e-3, "average") for run in (tmp_path / "whole", out))
    both = whole.covered[:5, :7] & pieces.covered[:5, :7]
    assert both.mean() > 0.9
    apart = (whole.value - pieces.value)[:5, :7] / np.hypot(whole.std, pieces.std)[:5, :7]
    assert np.sqrt(np.mean(apart[both] ** 2)) < 1.5


def last_time(table):
    """Time [s] of the last whole row of a table of estimates; 0 where there is none."""
    rows = table.read_text().splitlines()[1:-1] if table.exists() else []
    return float(rows[-1].split(",")[0]) if rows else 0.0


@pytest.mark.slow
def test_a_motion_that_can_only_be_done_as_one_does_not_resume(palpate, sweep_run, tmp_path):
    cut = tmp_path / "cut"
    shutil.copytree(sweep_run, cut)
    rows = (cut / "estimates.csv").read_text().splitlines(keepends=True)
    (cut / "estimates.csv").write_text("".join(rows[:1000]))
    done = palpate("run", "resume", cut)
    assert done.returncode == 2
    assert "cannot be continued" in done.stderr


@pytest.mark.slow
def test_a_plan_is_drawn_before_anything_moves(palpate, root, tmp_path):
    done = palpate("check", "motion", root / "pipelines" / "raster.toml", "--out", tmp_path / "plan.png")
    assert done.returncode == 0, done.stderr
    for text in ("duration", "speed", "acceleration", "force         up to", "senses forces"):
        assert text in done.stdout
    assert (tmp_path / "plan.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("assignment", "word"),
    [
        ("trajectory.raster.pitch=0 mm", "pitch"),
        ("trajectory.raster.press.bias=25 mm", "thickness"),
        ('trajectory.raster.size=["100 mm", "40 mm"]', "outside the specimen"),
        ("trajectory.raster.speed=60 mm/s", "periods"),
    ],
)
def test_an_impossible_motion_is_refused_by_name(palpate, root, assignment, word):
    done = palpate("check", "motion", root / "pipelines" / "raster.toml", "--set", assignment)
    assert done.returncode == 2
    assert word in done.stderr
    assert "Traceback" not in done.stderr


SAFETY = (
    'safety.low=["-50 mm", "-50 mm", "-10 mm"]',
    'safety.high=["50 mm", "50 mm", "20 mm"]',
    "safety.force=40 N",
    "safety.stop_force=20 N",
    "safety.stiffness=3 N/mm",
)


@pytest.mark.slow
@pytest.mark.parametrize("command", ["check motion", "run"])
def test_a_motion_outside_of_the_workspace_is_refused_by_name(palpate, root, tmp_path, command):
    file = root / "pipelines" / "raster.toml"
    kept = palpate("check", "motion", file, *options(SAFETY), "--out", tmp_path / "plan.png")
    assert kept.returncode == 0, kept.stderr
    assert "every limit of [safety] is kept" in kept.stdout
    done = palpate(*command.split(), file, *options([*SAFETY, 'safety.high=["20 mm", "50 mm", "20 mm"]']))
    assert done.returncode == 2
    assert "x goes to 30.00 mm, above the limit of 20.00 mm" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("--track", "dr/none"), "no track"),
        (("--parameter", "weight"), "has no 'weight'"),
        (("--method", "wavelets"), "is not one of"),
    ],
)
@pytest.mark.parametrize("command", ["map", "map lumps"])
def test_what_is_not_there_is_said(palpate, sweep_run, command, arguments, word):
    done = palpate(*command.split(), sweep_run, *arguments)
    assert done.returncode == 2
    assert word in done.stderr
    assert "Traceback" not in done.stderr


def test_a_sweep_is_told_by_its_range_and_not_by_its_last_sample(raster_run):
    """Background 112 kPa, and a sphere: the ranges of the table are those of the estimates along the way."""
    path = read_path(raster_run, "dr/smoother")
    found = json.loads((raster_run / "result.json").read_text())["tracks"]["dr/smoother"]["parameters"]["elasticity"]
    low, high = found["places"]["low"], found["places"]["high"]
    assert (low, high) == pytest.approx(tuple(np.quantile(path.value, [0.01, 0.99])), rel=0.02)
    assert low == pytest.approx(112e3, rel=0.03)
    assert high > 120e3
    assert found["value"] == pytest.approx(float(np.mean(sites_along(path).value)), rel=0.01)
    assert found["places"]["median"] == pytest.approx(float(np.median(path.value)), rel=0.01)
    assert found["combined"] >= found["systematic_places"] == found["places"]["spread"] > 3e3
    assert found["last"]["value"] == pytest.approx(float(path.value[-1]), rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("killed", ["run", "part-2"])
def test_the_best_track_of_each_part_is_taken_and_named(palpate, raster_run, tmp_path, killed):
    """A part that was killed has no estimates by the smoother, whichever part it is."""
    run = shutil.copytree(raster_run, tmp_path / "run", ignore=shutil.ignore_patterns("maps"))
    shutil.copytree(raster_run, run / "part-2", ignore=shutil.ignore_patterns("maps"))
    folder = run if killed == "run" else run / killed
    for name in ("estimates-offline.csv", "result.json"):
        (folder / name).unlink()
    path = read_path(run)
    assert path.source == f"dr/smoother; of {killed}: dr/kinematic"
    found = json.loads(palpate("map", "lumps", run, "--json").stdout)
    assert (found["track"], found["other_tracks"]) == ("dr/smoother", {killed: "dr/kinematic"})
    assert f"of {killed}: dr/kinematic: background" in palpate("map", "lumps", run).stdout


@pytest.mark.slow
def test_a_run_of_a_sweep_prints_ranges_and_means(palpate, root, tmp_path):
    line = ['trajectory.sweep.start=["0 mm", "-22 mm"]', 'trajectory.sweep.end=["0 mm", "-10 mm"]']
    settings = [*line, "trajectory.sweep.settle=2 s", 'run.tracks=["dr/kinematic"]']
    done = palpate("run", root / "pipelines" / "sweep.toml", *options(settings), "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    rows = [line for line in done.stdout.splitlines() if line.startswith(("  E ", "  eta "))][:2]
    printed = [re.search(r" ([\d.]+) to ([\d.]+), mean ([\d.]+) ± ([\d.]+) ", row) for row in rows]
    parameters = json.loads((tmp_path / "out" / "result.json").read_text())["tracks"]["dr/kinematic"]["parameters"]
    for row, found, factor in zip(printed, parameters.values(), (1e-3, 1.0), strict=True):
        low, high, mean, std = map(float, row.groups())
        places = found["places"]
        truth = [factor * number for number in (places["low"], places["high"], found["value"])]
        assert [low, high, mean] == pytest.approx(truth, rel=5e-3)
        # The ± is that of one place: how the places differ is the range.
        assert std == pytest.approx(factor * math.sqrt(found["combined"] ** 2 - places["spread"] ** 2), rel=0.06)
    assert f"range and mean along the path of the tip; by place: palpate map {tmp_path / 'out'}" in " ".join(
        done.stdout.split()
    )


@pytest.mark.slow
def test_no_map_is_written_over_an_earlier_one(palpate, raster_run, tmp_path):
    out = tmp_path / "maps"
    said = []
    for cell in ("2 mm", "4 mm", "2 mm"):
        done = palpate("map", raster_run, "--cell", cell, "--method", "average", "--out", out)
        assert done.returncode == 0, done.stderr
        said += re.findall(r"map(?:-\d)?\.csv", done.stdout)
    assert said == ["map.csv", "map-2.csv", "map.csv"]  # the third is the first again
    assert sorted(path.name for path in out.iterdir()) == [
        f"{name}.{ending}" for name in ("map-2", "map") for ending in ("csv", "npz", "png")
    ]


@pytest.mark.slow
def test_a_map_of_an_offline_track_wants_all_parts(palpate, raster_run, tmp_path):
    """The first part was killed: it has no offline estimates. A map of the second alone is no map of the run."""
    run = tmp_path / "run"
    shutil.copytree(raster_run, run, ignore=shutil.ignore_patterns("maps", "estimates-offline.csv", "result.json"))
    shutil.copytree(raster_run, run / "part-2", ignore=shutil.ignore_patterns("maps"))
    done = palpate("map", run, "--track", "dr/smoother", "--method", "average")
    assert done.returncode == 2
    assert "has no estimates of dr/smoother" in done.stderr
    assert "dr/kinematic" in done.stderr
    for track in ((), ("--track", "dr/kinematic")):
        assert palpate("map", run, *track, "--method", "average").returncode == 0


def test_a_folder_that_is_no_run_is_refused(palpate, tmp_path):
    for command in ("map lumps", "map search", "run resume"):
        done = palpate(*command.split(), tmp_path)
        assert done.returncode == 2, command
        assert "not a run folder" in done.stderr


@pytest.fixture(scope="module")
def beside_a_sphere(root, tmp_path_factory):
    """Two lines over 30 mm x 10 mm, and a sphere whose middle lies 6 mm outside of their box; run once."""
    folder = tmp_path_factory.mktemp("beside") / "run"
    settings = [
        'device.rig.specimen.inclusions=[{shape="sphere", place=["21 mm", "1 mm"], depth="2 mm", radius="5 mm"}]',
        'trajectory.raster.size=["30 mm", "10 mm"]',
        "trajectory.raster.pitch=10 mm",
        "trajectory.raster.settle=1 s",
        "trajectory.raster.speed=6 mm/s",
        "estimator.smoother.sweep_speed=6 mm/s",
        'run.tracks=["dr/smoother"]',
        "device.rig.sensor_rate=500 Hz",
        "trajectory.raster.press.amplitude=1 mm",
        "trajectory.raster.press.standstill=0.5 s",
    ]
    run_pipeline(load_pipeline(root / "pipelines" / "raster.toml", settings), folder)
    return folder


def searched(palpate, lines, folder, *more):
    """`palpate map search --go` from a copy of a run."""
    shutil.copytree(lines, folder)
    done = palpate("map", "search", folder, "--go", "--palpation", 1, *more)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_a_search_goes_on_beyond_the_border_of_the_sites(palpate, beside_a_sphere, tmp_path):
    """The sphere's middle lies 6 mm outside of the box that the lines cover."""
    text = searched(palpate, beside_a_sphere, tmp_path / "run", "--budget", 60)
    end = text.partition("stopped: ")[2]
    x, y = re.search(r"the lump at (-?[\d.]+) mm, (-?[\d.]+) mm: p = \S+, certain$", end, re.MULTILINE).groups()
    assert float(x) == pytest.approx(21.0, abs=2.0)
    assert float(y) == pytest.approx(1.0, abs=2.0)
    visited = sites_along(read_path(tmp_path / "run" / "part-2"))
    assert not visited.standing.any()  # a line: it tells more in a second


@pytest.mark.slow
def test_a_search_says_where_it_may_not_go_on(palpate, beside_a_sphere, tmp_path):
    """The same sphere, and an area that ends before it: nothing is visited beyond, and that is said."""
    area = "-15 mm, 16 mm, -8 mm, 8 mm"
    text = searched(palpate, beside_a_sphere, tmp_path / "run", "--budget", 30, "--area", area)
    assert "it reaches the border of --area, so its middle may lie beyond" in text
    places = np.concatenate([sites_along(read_path(part)).place for part in (tmp_path / "run").glob("part-*")])
    assert places[:, 0].max() < 16.1e-3


@pytest.mark.parametrize(
    ("area", "message"),
    [
        ("1 mm, 2 mm", "are 2 lengths; write four"),
        ("10 mm, -10 mm, 0 mm, 5 mm", "is empty"),
        ("10 N, 20 mm, 0 mm, 5 mm", "--area"),
        (
            "200 mm, 210 mm, 0 mm, 5 mm",
            "200 to 210 mm, 0 to 5 mm: nothing in it may be palpated: the trajectory touches",
        ),
    ],
)
def test_an_impossible_area_is_refused(palpate, raster_run, area, message):
    done = palpate("map", "search", raster_run, "--area", area)
    assert done.returncode == 2
    assert message in " ".join(done.stderr.split())


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--risk", "1.5", "is not a probability between 0 and 1"),
        ("--budget", "-5", "is not a time above 0"),
        ("--budget", "nan", "is not a time above 0"),
        ("--palpation", "0", "is not a time above 0"),
        ("--aim", "fnd", "is not one of find, outline, map"),
    ],
)
def test_an_impossible_search_is_refused(palpate, raster_run, option, value, message):
    done = palpate("map", "search", raster_run, option, value)
    assert done.returncode == 2
    assert option in done.stderr
    assert message in " ".join(done.stderr.split())


@pytest.mark.slow
def test_the_recorded_sweep_holds_a_sphere_and_a_horseshoe_and_nothing_else(palpate, root, shared, tmp_path):
    """Default settings from the command line to the lumps, by all filters; y [mm] of the record begins at 454."""
    file = f"device.log.file={shared / 'ur3e-bota-2024' / 'tran_4mms.csv.gz'}"
    run = tmp_path / "out"
    done = palpate("run", root / "pipelines" / "figures" / "recorded.toml", *options([file]), "--out", run)
    assert done.returncode == 0, done.stderr

    def lumps(track, method):
        done = palpate("map", "lumps", run, "--track", f"dr/{track}", "--method", method, "--json")
        return json.loads(done.stdout)["lumps"]

    for track in ("smoother", "kinematic"):
        sphere, horseshoe = lumps(track, "prominence")
        assert 1e3 * sphere["y"] == pytest.approx(471.0, abs=1.5)
        assert 1e3 * horseshoe["y"] == pytest.approx(497.0, abs=1.5)
        assert horseshoe["p"] < 1e-3
        assert 0.045 < horseshoe["contrast"] < 0.07
    for track, method in itertools.product(("smoother", "kinematic", "afukf", "afekf"), ("prominence", "cusum")):
        sphere, *others = lumps(track, method)
        assert 1e3 * sphere["y"] == pytest.approx(471.0, abs=1.5)
        assert len(others) <= 1
        assert all(abs(1e3 * lump["y"] - 497.0) < 2e3 * lump["place_std"][1] for lump in others)
    assert lumps("ekf", "prominence") == []


@pytest.mark.slow
def test_curves_of_filters_are_compared_with_points(palpate, root, tmp_path):
    """As in the paper's figure, over a shorter line with the sphere in its middle."""
    points = tmp_path / "points.toml"
    text = (root / "pipelines" / "points.toml").read_text().replace('duration = "4 s"', 'duration = "2 s"')
    points.write_text(text.replace('size = ["70 mm", "0 mm"]', 'size = ["20 mm", "0 mm"]\ncentre = ["0 mm", "-14 mm"]'))
    line = ('trajectory.sweep.start=["0 mm", "-30 mm"]', 'trajectory.sweep.end=["0 mm", "0 mm"]')
    few = options([*line, "trajectory.sweep.settle=2 s", 'run.tracks=["*/kinematic", "*/ekf"]'])
    done = palpate("run", root / "pipelines" / "sweep.toml", "--out", tmp_path / "out", *few)
    assert done.returncode == 0, done.stderr
    picture = tmp_path / "out" / "sweep.png"
    done = palpate("map", "curves", tmp_path / "out", "--points", points, "--out", picture)
    assert done.returncode == 0, done.stderr
    table = {
        row.split("│")[1].strip(): row.split("│")
        for row in done.stdout.partition("along the sweep")[2].splitlines()
        if row.startswith("│")
    }
    assert float(table["dr/kinematic"][2].split()[0]) == pytest.approx(-14.0, abs=1.0)
    assert float(table["dr/kinematic"][3]) < 2.0 < 5.0 < float(table["dr/ekf"][3])
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "out" / "points" / "result.json").is_file()


@pytest.mark.slow
def test_settings_are_compared_along_a_sweep(palpate, root, tmp_path):
    line = ['trajectory.sweep.start=["0 mm", "-30 mm"]', 'trajectory.sweep.end=["0 mm", "0 mm"]']
    few = ["trajectory.sweep.settle=2 s", 'sweep.estimator.afukf.fading.theta=["1 mm/s", "2 mm/s"]']
    file = tmp_path / "fading.toml"
    text = (root / "pipelines" / "figures" / "fading.toml").read_text()
    file.write_text(text.partition("[sweep]")[0])
    done = palpate("sweep", file, "--picture", "--jobs", 1, "--out", tmp_path / "out", *options([*line, *few]))
    assert done.returncode == 0, done.stderr
    for label in ("theta 1 mm/s", "theta 2 mm/s"):
        assert label in done.stdout
    assert (tmp_path / "out" / "sweep.png").read_bytes().startswith(b"\x89PNG")


def test_too_few_baseline_sites_are_refused(palpate, sweep_run, tmp_path):
    other = shutil.copytree(sweep_run, tmp_path / "other")
    done = palpate("map", "compare", "--baseline", sweep_run, "--suspect", other)
    assert done.returncode == 2
    assert "too few for prediction; 4 are needed" in done.stderr
