"""What `palpate run resume` finds left in run folders that were cut, simulated and live."""

from dataclasses import replace

import numpy as np
import pytest
from palpate_commands.resume import remaining_pipeline
from palpate_engine.config import load_pipeline, resolved_text
from palpate_kit.runs.continuation import continue_pipeline
from palpate_kit.runs.run_folder import RunFolder

SMALL = ('trajectory.raster.size=["20 mm", "20 mm"]', "trajectory.raster.settle=1 s")


@pytest.fixture
def simulated(root):
    """The example raster, smaller."""
    return load_pipeline(root / "pipelines" / "raster.toml", SMALL)


@pytest.fixture
def live(root):
    """A raster with a robot, which goes to the start first."""
    pipeline = load_pipeline(root / "pipelines" / "point_ur3e.toml")
    (raster,) = load_pipeline(root / "pipelines" / "raster.toml", SMALL).trajectories.values()
    return replace(pipeline, trajectories={"raster": raster})


def write(folder, pipeline, until, delay=0.0, noise=0.0, retraction=0.0):
    """A run folder as a kill leaves it: the pipeline as resolved, and estimates up to a time of the motion [s].

    Then the tip stays above the place for the time of a retraction [s].
    """
    folder.mkdir(parents=True)
    (folder / "resolved.toml").write_text(resolved_text(pipeline))
    (motion,) = pipeline.trajectories.values()
    time = np.arange(0.0, until + delay + retraction, 0.01)
    place = motion.at(np.minimum(time - delay, until)).position[:, :2] + noise * np.random.default_rng(1).normal(
        size=(len(time), 2)
    )
    rows = [f"{t:.4f},{x:.9f},{y:.9f}" for t, (x, y) in zip(time, place, strict=True)]
    (folder / "estimates.csv").write_text("\n".join(["time_s,x_m,y_m", *rows]) + "\n")


def motion_of(pipeline):
    (motion,) = pipeline.trajectories.values()
    return motion


@pytest.mark.slow
def test_a_rest_that_is_cut_again_leaves_the_lines_that_nobody_has_made(simulated, tmp_path):
    firsts, pipeline, folder = [], simulated, tmp_path / "run"
    for share in (0.5, 0.6, 1.0):
        motion = motion_of(pipeline)
        firsts.append(motion.first_line)
        write(folder, pipeline, share * motion.total_duration)
        pipeline, folder = remaining_pipeline(tmp_path / "run"), RunFolder(tmp_path / "run").next_part
    assert firsts == [0, 2, 3]
    assert pipeline is None


@pytest.mark.slow
def test_what_a_raster_left_is_left_after_a_search_too(simulated, tmp_path):
    raster = motion_of(simulated)
    write(tmp_path / "run", simulated, 0.5 * raster.total_duration)
    left = motion_of(remaining_pipeline(tmp_path / "run"))
    assert 0 < left.first_line < raster.lines
    visits = simulated.registry.find("trajectory", "grid-points")(
        places=((0.0, 0.0), (5e-3, 0.0), (0.0, 5e-3)), duration=2.0, press=raster.press, surface=raster.surface
    )
    search = continue_pipeline(simulated, visits, 1)
    write(tmp_path / "run" / "part-2", search, 0.5 * visits.total_duration)
    rest = remaining_pipeline(tmp_path / "run")
    assert motion_of(rest) == left
    write(tmp_path / "run" / "part-3", rest, left.total_duration)
    places = motion_of(remaining_pipeline(tmp_path / "run"))
    assert 0 < places.first_point < 3
    write(tmp_path / "run" / "part-4", continue_pipeline(simulated, places, 3), places.total_duration)
    assert remaining_pipeline(tmp_path / "run") is None


def test_a_part_that_ended_before_it_began_has_done_nothing(simulated, tmp_path):
    write(tmp_path / "run", simulated, 0.5 * motion_of(simulated).total_duration)
    left = remaining_pipeline(tmp_path / "run")
    (tmp_path / "run" / "part-2").mkdir()
    assert motion_of(remaining_pipeline(tmp_path / "run")) == motion_of(left)
    (tmp_path / "run" / "part-2" / "resolved.toml").write_text(resolved_text(left))
    assert motion_of(remaining_pipeline(tmp_path / "run")) == motion_of(left)


@pytest.mark.slow
@pytest.mark.parametrize("delay", [1.0, 6.3])
def test_the_rest_and_the_way_to_the_start_are_no_time_of_the_motion(live, tmp_path, delay):
    """A record of a robot begins before its motion: a line that ended in that time's span was not made."""
    raster = motion_of(live)
    ends = [
        t for t in np.arange(0.0, raster.total_duration, 0.1) if raster.after(t) is None or raster.after(t) != raster
    ]
    until = float(ends[0]) - 0.5  # just before the first line was done
    write(tmp_path / "run", live, until, delay, noise=2e-6)
    assert motion_of(remaining_pipeline(tmp_path / "run")).first_line == 0
    write(tmp_path / "later", live, until + 1.5, delay, noise=2e-6)
    assert motion_of(remaining_pipeline(tmp_path / "later")).first_line == 1
    write(tmp_path / "up", live, until - 0.5, delay, noise=2e-6, retraction=2.0)  # no time of the motion either
    assert motion_of(remaining_pipeline(tmp_path / "up")).first_line == 0
