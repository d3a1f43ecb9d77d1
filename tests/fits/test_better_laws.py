"""The law that describes a material with memory better, as a command to type, for one file."""

import shlex
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from palpate_engine import registry
from palpate_fits.file_tables import law_line
from palpate_models import DimensionalityReduction, Sphere, StandardLinearSolid

from tests.fits.test_two_tips import RIG, write

LAWS = ("standard-linear-solid", "generalised-maxwell-2")


@pytest.mark.parametrize(
    ("model", "laws", "line"),
    [
        (DimensionalityReduction, LAWS, "a better law? palpate fit choose 'my fits' --models own," + ",".join(LAWS)),
        (StandardLinearSolid, LAWS, "a better law? palpate fit choose 'my fits' --models own," + LAWS[1]),
        (StandardLinearSolid, LAWS[:1], ""),
        (DimensionalityReduction, (), ""),
    ],
)
def test_the_command_names_the_laws_that_are_not_the_models(model, laws, line):
    track = SimpleNamespace(model=model(indenter=Sphere(radius=5e-3)), name=SimpleNamespace(model="own"))
    assert law_line(Path("my fits"), track, registry.load(), laws) == line


def press(seed):
    """Time [s], force [N] and height [mm] of a press and hold on 50 kPa of which 40 % more fade in 0.3 s; 1 mN."""
    time = np.arange(800) / 200.0
    depth = np.interp(time, [0.0, 0.4, 1.0, 4.0], [-0.4e-3, -0.1e-3, 1e-3, 1e-3])
    spring = 16 / 9 * 50e3 * np.sqrt(6e-3) * np.maximum(depth, 0.0) ** 1.5
    memory = np.zeros(len(time))
    for k in range(1, len(time)):
        memory[k] = (memory[k - 1] + 0.4 * (spring[k] - spring[k - 1])) / (1 + 0.005 / 0.3)
    noise = 1e-3 * np.random.default_rng(seed).standard_normal(len(time))
    return np.column_stack([time, spring + memory + noise, -1e3 * depth])


@pytest.mark.slow
def test_the_command_for_a_material_with_memory_runs_as_printed(palpate, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for seed in (1, 2):
        write(f"press{seed}.csv", press(seed))
    Path("rig.toml").write_text(RIG + 'thickness = "half-space"\n')
    done = palpate("fit", "press1.csv", "-o", "fits")
    (line,) = [line for line in done.stdout.splitlines() if line.startswith("a better law? palpate ")]
    chosen = palpate(*shlex.split(line.removeprefix("a better law? palpate ")))
    assert chosen.returncode == 0, chosen.stderr
    assert "support standard-linear-solid" in " ".join(chosen.stdout.split())
    page = palpate("fit", "press1.csv", "--pipeline", "fits/pipeline.toml", "-o", "page", "--no-pictures")
    assert "a better law? palpate fit choose page/press1/pipeline.toml" in page.stdout
    # Of several files each would be its own choice.
    assert "a better law?" not in palpate("fit", "press1.csv", "press2.csv", "-o", "both").stdout
