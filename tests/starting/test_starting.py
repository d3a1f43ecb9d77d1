"""Pipelines and distributions to start from, and completion."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from palpate import ConfigurationError, OutputError
from palpate_commands.completion import completion
from palpate_commands.distribution import KINDS, distribution
from palpate_commands.init import init
from palpate_engine import load_pipeline, registry, run_pipeline

ROOT = Path(__file__).parent.parent.parent
PIPELINES = {
    "point": "point",
    "ur3e": "point_ur3e",
    "raster": "raster",
    "calibrate": "guided",
    "breast-ur3e": "breast_ur3e",
}
BLOCK = re.compile(r"^```python\n# file: (\S+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("what", [*PIPELINES, "log"])
def test_a_pipeline_to_start_from_is_in_order(what, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    init(what)
    text = (tmp_path / f"{what}.toml").read_text()
    assert text.count('palpate = "0.2"') == 1
    assert "#:schema" not in text
    load_pipeline(Path(f"{what}.toml"), estimates=what != "calibrate")


@pytest.mark.parametrize("what", PIPELINES)
def test_it_is_the_one_of_the_repository(what, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    init(what, Path("sub/mine.toml"))
    written = tomllib.loads((tmp_path / "sub" / "mine.toml").read_text())
    assert written.pop("palpate") == "0.2"
    assert written == tomllib.loads((ROOT / "pipelines" / f"{PIPELINES[what]}.toml").read_text())
    assert f"pipelines/{PIPELINES[what]}.toml" not in (tmp_path / "sub" / "mine.toml").read_text()


@pytest.mark.slow
def test_the_log_finds_what_it_was_simulated_with(tmp_path):
    init("log", tmp_path / "mine.toml")
    result = run_pipeline(load_pipeline(tmp_path / "mine.toml"), tmp_path / "out")
    for track in result.tracks.values():
        assert track.verdict == "good"
        for name, truth in {"elasticity": 112.5e3, "viscosity": 362.0}.items():
            found = track.parameters[name]
            assert abs(found.value - truth) < 2 * found.combined


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (("pont",), "did you mean 'point'"),
        (("log-analysis",), "no pipeline"),  # only a part of one
        (("x", None, "tipp"), "did you mean 'tip'"),
        (("Bad_Name", None, "tip"), "small letters"),
    ],
)
def test_mistakes_are_told(arguments, what):
    with pytest.raises(ConfigurationError, match=what):
        init(*arguments)


def test_nothing_is_overwritten(tmp_path):
    (tmp_path / "log.csv").write_text("mine")
    with pytest.raises(OutputError, match=r"log\.csv: exists already"):
        init("log", tmp_path / "log.toml")
    assert not (tmp_path / "log.toml").exists()
    with pytest.raises(OutputError, match="exists already"):
        init("mine", tmp_path, "tip")


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A distribution of every kind, installed beside each other; where their sources are, and where they went."""
    folder = tmp_path_factory.mktemp("own")
    for kind in KINDS:
        init(f"own-{kind}", folder / f"own-{kind}", kind)
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
    environment = {**os.environ, "PIP_DISABLE_PIP_VERSION_CHECK": "1", "PIP_ROOT_USER_ACTION": "ignore"}
    sources = [folder / f"own-{kind}" for kind in KINDS]
    subprocess.run([*command, "--target", folder / "site", *sources], check=True, env=environment, timeout=120)
    return folder


@pytest.mark.gate
@pytest.mark.slow
def test_plugins_of_ones_own_pass_their_tests_when_installed(installed):
    site = os.pathsep.join([str(installed / "site"), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--import-mode=importlib"]
    tests = [installed / f"own-{kind}" / "tests" for kind in KINDS]
    done = subprocess.run(
        [*command, *tests], cwd=installed, env={**os.environ, "PYTHONPATH": site}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout
    assert f"{2 * len(KINDS) + 1} passed, 1 deselected" in done.stdout  # the part, its discovery; the arm's posture


@pytest.mark.slow
def test_their_types_hold_for_a_strict_checker(tmp_path):
    packages = []
    for kind in KINDS:
        for path, text in distribution(kind, f"own-{kind}").items():
            (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / path).write_text(text)
        packages.append(f"own_{kind}")
        assert (tmp_path / f"own_{kind}" / "py.typed").read_text() == ""
    sources = [str(ROOT / "core"), *(str(path) for path in (ROOT / "plugins").iterdir() if path.is_dir())]
    command = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "--ignore-missing-imports"]
    environment = {**os.environ, "MYPYPATH": os.pathsep.join(sources)}
    done = subprocess.run([*command, *packages], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


@pytest.mark.slow
def test_their_parts_are_listed(installed, palpate):
    listed = palpate("list", PYTHONPATH=str(installed / "site")).stdout
    for part, kind in {"funnel": "tip", "foam": "model", "known-surface": "filter", "dip": "trajectory"}.items():
        assert re.search(rf"{part}\b.*own-{kind} 0\.1\.0", listed, re.DOTALL)


@pytest.mark.parametrize(
    ("kind", "family", "file", "module"),
    [
        ("tip", "models", "my_tip", "funnel"),
        ("model", "models", "my_model", "foam"),
        ("filter", "filters", "my_filter", "known_surface"),
        ("device", "devices", "my_device", "pendulum"),
        ("trajectory", "trajectories", "my_trajectory", "dip"),
        ("analysis", "studies", "my_histogram", "histogram"),
    ],
)
def test_they_are_what_the_readmes_show(kind, family, file, module):
    """Below the imports, the same part; a file of one's own has its hook, too, and a distribution names the part."""
    shown = dict(BLOCK.findall((ROOT / "plugins" / family / "README.md").read_text()))[f"{file}.py"]
    written = distribution(kind, "palpate-mine")[f"palpate_mine/{module}.py"]
    assert written.partition("\n\n\n")[2] in shown


@pytest.mark.slow
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_knows_commands_options_and_parts(shell, capsys):
    completion(shell)
    printed = capsys.readouterr().out
    for name in registry.load_commands().commands:
        assert name.split()[-1] in printed
    assert "add-estimator" in printed
    assert "dimensionality-reduction" in printed


@pytest.mark.slow
def test_bash_completes(capsys):
    completion("bash")
    script, wanted = (
        capsys.readouterr().out,
        {"run --see": "--seed", "map lu": "lumps", "map lumps --con": "--contrast"},
    )
    for words in wanted:
        script += f'COMP_WORDS=(palpate {words}); COMP_CWORD={len(words.split())}; _palpate; echo "${{COMPREPLY[@]}}"\n'
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == [*wanted.values()], done.stderr


def test_a_shell_that_is_none():
    with pytest.raises(ConfigurationError, match="no completion for 'sh'"):
        completion("sh")
