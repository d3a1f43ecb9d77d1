"""A filter as C99 gives palpate's numbers over a whole run, from free air on."""

import re
import shutil
import subprocess
from graphlib import TopologicalSorter

import pytest

from tests import command

PIPELINE = """
[run]
seed = 3
[device.rig]
type = "sim"
tip_mass = "140 g"
[device.rig.specimen]
model = "dr"
elasticity = "80 kPa"
viscosity = "200 Pa*s"
surface = "0.3 mm"
[trajectory.press]
type = "point"
bias = "3 mm"
amplitude = "0.8 mm"
frequency = "2 Hz"
duration = "1.2 s"
[alignment]
force = "rig.wrench.z"
position = "rig.tip.z"
velocity = "rig.twist.z"
measuring = "rig.setpoint.measuring"
tip_mass = "140 g"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
[model.sls]
type = "dimensionality-reduction-maxwell"
indenter = "tip"
[estimator.filter]
"""
needs_compiler = pytest.mark.skipif(not (shutil.which("cc") and shutil.which("make")), reason="no C compiler here")


KINEMATIC = 'type = "kinematic-ekf"'


@pytest.fixture(scope="module")
def exports(tmp_path_factory):
    """What the command says of an estimator, and the folder that it writes, made once for all tests."""
    known = {}

    def export(estimator, track="dr/filter"):
        if (estimator, track) not in known:
            folder = tmp_path_factory.mktemp("export")
            (folder / "point.toml").write_text(PIPELINE + estimator)
            words = ("model", "export", "point.toml", "--track", track, "-o", "filter")
            known[estimator, track] = command.call(*words, cwd=folder), folder / "filter"
        return known[estimator, track]

    return export


@pytest.fixture
def exported(exports, tmp_path):
    """A copy of the folder of an estimator, which a test may change."""

    def copy(estimator):
        done, folder = exports(estimator)
        assert done.returncode == 0, done.stderr
        return shutil.copytree(folder, tmp_path / "filter")

    return copy


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize(
    ("estimator", "track"),
    [
        pytest.param(KINEMATIC, "dr/filter", marks=pytest.mark.gate),
        ('type = "kinematic-ekf"\nbias_std = "20 mN"\nnoise = "measure"\nstudent = 4', "dr/filter"),
        (KINEMATIC, "sls/filter"),
        ('type = "ekf"', "dr/filter"),
        pytest.param('type = "afukf"\nstart_from = "fit"', "dr/filter", marks=pytest.mark.gate),
    ],
)
def test_c_gives_the_same_numbers_over_a_whole_run(exports, estimator, track):
    done, folder = exports(estimator, track)
    assert done.returncode == 0, done.stderr
    compared, samples, shared, largest = re.search(
        r"(\d+) of (\d+) samples have an estimate, (\d+) in shares; largest difference (\S+)", done.stdout
    ).groups()
    assert compared == samples
    assert int(samples) - 5 <= int(shared) <= int(samples)  # those at the end may wait for the samples after them
    assert int(samples) > 1000
    assert float(largest) <= 1e-12
    rows = [line.split(",") for line in (folder / "vectors.csv").read_text().splitlines()[1:]]
    assert sum(row[-1] == "0.0" for row in rows) > 90  # estimates to compare, not only waiting
    assert "nan" in rows[0][7]  # from free air on


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("share", [700, 4000])
def test_shares_of_any_size_give_the_same_numbers(exported, share):
    """Where a sample stops, and the next goes on, is anywhere in the searches; a small share takes its time."""
    folder = exported(KINEMATIC)
    header, code = folder / "palpate_filter.h", folder / "palpate_filter.c"
    header.write_text(re.sub(r"(#define PALPATE_RECORD) \d+", r"\1 4000", header.read_text()))
    code.write_text(re.sub(r"settings->share = \d+", f"settings->share = {share}", code.read_text()))
    done = subprocess.run(["make", "-C", code.parent, "-s", "check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    samples, shared = map(int, re.search(r"of (\d+) samples have an estimate, (\d+) in shares", done.stdout).groups())
    assert 0.6 * samples < shared <= samples


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("estimator", ['type = "ekf"', KINEMATIC])
def test_it_neither_allocates_nor_calls_itself(exported, estimator):
    """By the compiler's own graph of calls: no cycle, nothing from outside but functions of libm, a bounded stack."""
    folder = exported(estimator)
    compiler = ["gcc", "-std=c99", "-O2", "-ffp-contract=off", "-fcallgraph-info=su", "-c", "palpate_filter.c"]
    if subprocess.run(compiler, cwd=folder, capture_output=True).returncode:
        pytest.skip("this compiler draws no graph of calls")
    graph = (folder / "palpate_filter.ci").read_text()
    stack = dict(
        re.findall(r'node: { title: "([^"]+)" label: "[^"]*?(\d+) bytes \((?:static|dynamic,bounded)\)', graph)
    )
    calls = {name: set() for name in stack}
    for caller, called in re.findall(r'edge: { sourcename: "([^"]+)" targetname: "([^"]+)"', graph):
        calls[caller].add(called)
    outside = set().union(*calls.values()) - set(stack)
    listener = "__indirect_call"
    assert outside <= {listener, "sqrt", "exp", "log", "pow", "frexp", "ldexp", "rint", "fabs", "memcpy", "memset"}
    assert listener in outside  # and its own stack is its owner's
    deepest = {}
    for name in TopologicalSorter(calls).static_order():  # CycleError where a function calls itself
        deepest[name] = int(stack.get(name, 0)) + max((deepest[called] for called in calls.get(name, ())), default=0)
    assert 200 < deepest["palpate_feed"] < 8_000  # bytes


@pytest.mark.slow
@needs_compiler
def test_the_check_sees_a_number_that_is_off(exported):
    code = exported('type = "ekf"') / "palpate_filter.c"
    text = code.read_text()
    assert "settings->step.velocity_std = 0.00067;" in text
    code.write_text(text.replace("settings->step.velocity_std = 0.00067;", "settings->step.velocity_std = 0.00067001;"))
    done = subprocess.run(["make", "-C", code.parent, "check"], capture_output=True, text=True)
    assert done.returncode != 0
    assert "numbers differ" in done.stdout


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("arm-none-eabi-gcc"), reason="no gcc-arm-none-eabi here")
def test_it_compiles_for_a_microcontroller(exported):
    done = subprocess.run(["make", "-C", exported(KINEMATIC), "-s", "arm"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    code, data, memory = (int(word) for word in done.stdout.splitlines()[1].split()[:3])
    assert code < 40_000
    assert data == memory == 0


@pytest.mark.parametrize(
    ("estimator", "track", "told"),
    [
        ('type = "filterpy"', "dr/filter", "FilterpyFilter cannot be exported: it has no compiled step"),
        ('type = "kinematic-smoother"', "dr/filter", "it needs the whole record"),
        ('type = "ekf"', "dr/filer", "did you mean 'dr/filter'?"),
    ],
)
def test_what_cannot_be_exported_is_refused_by_name(exports, estimator, track, told):
    done, folder = exports(estimator, track)
    assert done.returncode == 2
    assert told in done.stderr
    assert not folder.exists()
