"""Strangers' files on the command line: markup, control characters, giant numbers, plugins; outputs that fail."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from palpate import trust
from palpate.errors import ConfigurationError, PluginError
from palpate.plugin_switch import SWITCH
from palpate.units import to_si
from palpate_engine.config import load_pipeline

from tests.processes import DEVNULL, PALPATE, PIPE, start

SHORT = ("--set", "trajectory.press.duration=1 s", "--set", 'run.tracks=["dr/ekf"]')
MARKER = "import pathlib\npathlib.Path({}).touch()\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("device = 1\n", "is not a table: name each device"),
        ("run = 1\n", "must be a table"),
        ('[run]\n"a[b" = 1\n', "unknown key 'a[b'"),
        ('[alignment]\nforce = "f"\nposition = "p"\n"x[0]" = 2\n', "unknown key 'x[0]'"),
        (f"[run]\nseed = {'9' * 5000}\n", "not TOML: "),
        (f"[run]\naverage = {'9' * 400}\n", "is not a finite time"),
        (f"[run]\naverage = '{'9' * 100_000} s'\n", "is too long for a time"),
        ("[run]\naverage = '5 ms**9**9**9'\n", "is not one unit"),
        (f"[run]\ntracks = {'[' * 5000}{']' * 5000}\n", "not TOML: "),
        (f"[run]\ntracks = {'[' * 40}{']' * 40}\n", "are nested more than 32 deep"),
    ],
)
def test_one_message_and_no_traceback(palpate, tmp_path, text, words):
    (tmp_path / "p.toml").write_text(text)
    done = palpate("check", "p.toml")
    assert done.returncode == 2, done.stderr[-2000:]
    assert words in done.stderr
    assert "Traceback" not in done.stderr


def test_units_are_one_number_and_one_unit():
    assert to_si("2 N*s/m", "N*s/m") == 2.0
    assert to_si("3 kg*m/s**2", "N") == to_si("3 kg m / s^2", "N") == 3.0
    assert to_si("4 N/(m*s)", "N/(m*s)") == 4.0
    for text in ("5 mm**9**9**9", "5 mm*10", "5 m**99", "5 m 5 m", "1" * 101 + " m", "1 m" + " " * 200_000 + "!"):
        began = time.process_time()
        with pytest.raises(ValueError, match=r"not one unit|too long|not a length"):
            to_si(text, "m")
        assert time.process_time() - began < 5.0  # a quadratic search takes minutes


def test_names_are_never_markup_and_never_steer_a_terminal(palpate, point_pipeline):
    name = "[/bold] [red]x\\u001b]0;title\\u0007"
    done = palpate("run", point_pipeline, *SHORT, "--set", f'run.name="{name}"', "--out", "out")
    assert done.returncode == 0, done.stderr
    assert r"[/bold] [red]x\x1b]0;title" in done.stdout
    assert "\x1b" not in done.stdout + done.stderr
    done = palpate("run", point_pipeline, "--set", 'estimator.ekf.type="\\u001b[31m[/x]"')
    assert done.returncode == 2
    assert "\x1b" not in done.stderr


@pytest.mark.slow
def test_an_output_that_takes_no_utf_8_or_is_full(point_pipeline, tmp_path):
    command = [
        sys.executable,
        "-c",
        "from palpate_engine.cli import main; main()",
        "describe",
        "dimensionality-reduction",
    ]
    for encoding in ("ascii", "latin-1"):
        done = subprocess.run(command, env={**os.environ, "PYTHONIOENCODING": encoding}, capture_output=True)
        assert done.returncode == 0, done.stderr
    for unbuffered in ("", "1"):
        with Path("/dev/full").open("w") as full:
            env = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
            done = subprocess.run(command, env=env, stdout=full, stderr=subprocess.PIPE, text=True)
        assert done.returncode == 2
        assert done.stderr == "palpate: standard output: cannot write: No space left on device\n"


@pytest.fixture
def stranger(point_pipeline, tmp_path):
    """A pipeline with a plugin file beside it that leaves a trace when it is executed."""
    (tmp_path / "mine.py").write_text(MARKER.format(repr(str(tmp_path / "trace"))))
    text = point_pipeline.read_text().replace("seed = 1\n", 'seed = 1\nplugins = ["mine.py"]\n', 1)
    point_pipeline.write_text(text)
    return point_pipeline


@pytest.mark.slow
@pytest.mark.parametrize("command", [("check",), ("check", "motion")])
def test_plugin_files_are_named_when_executed_and_can_be_forbidden(palpate, stranger, tmp_path, command, monkeypatch):
    done = palpate("--no-plugins", *command, stranger)
    assert done.returncode == 2
    assert f"plugin file {tmp_path}/mine.py is not executed" in done.stderr
    assert SWITCH not in os.environ
    monkeypatch.setenv(SWITCH, "off")
    assert palpate(*command, stranger).returncode == 2
    assert not (tmp_path / "trace").exists()
    monkeypatch.delenv(SWITCH)
    done = palpate(*command, stranger)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count(f"executing plugin file {tmp_path}/mine.py") == 1
    assert (tmp_path / "trace").exists()


class Terminal:
    """A terminal at which somebody gives answers."""

    def __init__(self, *answers):
        self.answers, self.shown = list(answers), ""

    def isatty(self):
        return True

    def readline(self):
        return self.answers.pop(0) + "\n"

    def write(self, text):
        self.shown += text

    def flush(self):
        pass


def asked(monkeypatch, files, base, *answers, named=True):
    """What a terminal showed where a pipeline in folder `base` names files."""
    terminal = Terminal(*answers)
    with monkeypatch.context() as patch, trust.at_the_command_line():
        patch.setattr(sys, "stdin", terminal)
        patch.setattr(sys, "stderr", terminal)
        trust.announce(trust.approved_files(files, base / "p.toml", named))
    assert terminal.answers == []
    return terminal.shown


def test_files_elsewhere_are_asked_about_once_for_their_contents(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (tmp_path / "here").mkdir()
    own, other = tmp_path / "here" / "own.py", tmp_path / "other.py"
    own.write_text("a = 1\n")
    other.write_text("b = 1\n")
    assert "Execute it?" not in asked(monkeypatch, [own], own.parent)
    with pytest.raises(PluginError, match="was refused"):
        asked(monkeypatch, [other], own.parent, "")
    assert "lies outside" in asked(monkeypatch, [own, other], own.parent, "y")
    assert "Execute it?" not in asked(monkeypatch, [own, other], own.parent)
    assert "Execute it?" not in asked(monkeypatch, [own], tmp_path / "elsewhere")  # known by its contents
    other.write_text("b = 2\n")
    assert "Execute it?" in asked(monkeypatch, [other], own.parent, "yes")
    monkeypatch.setattr(os, "getuid", lambda: own.stat().st_uid + 1)
    own.write_text("a = 2\n")
    assert "belongs to another user" in asked(monkeypatch, [own], own.parent, "y")


def test_files_that_a_recording_names_are_asked_about_wherever_they_are(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    own = tmp_path / "own.py"
    own.write_text("a = 1\n")
    with pytest.raises(PluginError, match="was refused"):
        asked(monkeypatch, [own], tmp_path, "", named=False)
    assert not trust.trusted_plugins()
    shown = asked(monkeypatch, [own], tmp_path, "y", named=False)
    assert f"{own} (SHA-256 {trust.PluginFile.read(own).digest[:12]}...) is named by the recording" in shown
    assert list(trust.trusted_plugins().values()) == [str(own)]
    assert "Execute it?" not in asked(monkeypatch, [own], tmp_path, named=False)


def test_who_has_refused_is_not_asked_again_by_the_same_command(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (tmp_path / "own.py").write_text("a = 1\n")
    terminal = Terminal("n")
    with monkeypatch.context() as patch, trust.at_the_command_line():
        patch.setattr(sys, "stdin", terminal)
        patch.setattr(sys, "stderr", terminal)
        for _ in range(2):
            with pytest.raises(PluginError, match="was refused"):
                trust.approved_files([tmp_path / "own.py"], tmp_path / "log.mcap", named=False)


def test_nobody_is_asked_without_a_terminal_or_a_command(tmp_path, capfd, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (tmp_path / "other.py").write_text("")
    place = tmp_path / "here" / "p.toml"
    trust.announce(trust.approved_files([tmp_path / "other.py"], place, named=True))
    assert capfd.readouterr().err == ""
    with trust.at_the_command_line():
        trust.announce(trust.approved_files([tmp_path / "other.py"], place, named=True))
    assert capfd.readouterr().err == f"executing plugin file {tmp_path}/other.py\n"


def test_only_an_address_is_loopback(root):
    for good in ("127.0.0.1", "127.255.0.9"):
        load_pipeline(root / "pipelines" / "point_ur3e.toml", [f"twin.bench.host={good}"])
    for bad in (
        "127.evil.example.com",
        "127.0.0.1.evil.com",
        "127.0.0.256",
        "127.1",
    ):
        with pytest.raises(ConfigurationError):
            load_pipeline(root / "pipelines" / "point_ur3e.toml", [f"twin.bench.host={bad}"])


def test_a_port_where_everybody_can_write_is_refused(palpate, root, tmp_path):
    """Another user could put a port there first, and the driver would take its readings for the sensor's."""
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o1777)
    done = palpate("twin", root / "pipelines" / "point_ur3e.toml", "--set", f"twin.bench.port={shared}/sensone")
    assert done.returncode == 2
    assert f"everybody can write in {shared}; choose a folder of your own, such as ~/sensone" in done.stderr
    assert list(shared.iterdir()) == []


@pytest.mark.slow
def test_a_twin_in_the_background_serves_until_it_is_signalled(root, tmp_path):
    address = f"127.{os.getpid() % 200 + 20}.77.{os.getpid() % 250 + 1}"
    sets = ["--set", f"twin.bench.host={address}", "--set", f"twin.bench.port={tmp_path}/port"]
    file = root / "pipelines" / "point_ur3e.toml"
    twin = start(PALPATE, "twin", file, *sets, stdin=DEVNULL, stdout=PIPE, text=True)
    try:
        assert twin.stdout.readline().startswith("ready: ")
        time.sleep(0.3)
        assert twin.poll() is None
        twin.send_signal(signal.SIGTERM)
        assert twin.wait(60) == 0
    finally:
        twin.kill()
        twin.stdout.close()
