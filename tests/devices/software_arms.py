"""What `palpate init --plugin arm` writes, with its arm in software: fixtures, and arms that do something else."""

import importlib
import sys

import pytest
from palpate import DeviceError, clock
from palpate_commands.distribution import distribution
from palpate_engine import trust_plugin
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_testing import simulated_time

NAME = "palpate_mine"
WORK = {"origin": (0.45, 0.0, 0.1)}
SHORT = ("trajectory.press.duration=1 s", "safety.standstill=0.2 s", "alignment.tare_duration=0.15 s")


@pytest.fixture(scope="module")
def mine(tmp_path_factory):
    """The module of the arm that is written, next to its driver and arm in software; the folder of the distribution."""
    folder = tmp_path_factory.mktemp("arm") / "palpate-mine"
    for path, text in distribution("arm", "palpate-mine").items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
    (folder / "mine.py").write_text(f"from {NAME} import palpate_devices\n")
    sys.path.insert(0, str(folder))
    yield importlib.import_module(f"{NAME}.arm"), folder
    sys.path.remove(str(folder))
    for name in [name for name in sys.modules if name.partition(".")[0] == NAME]:
        del sys.modules[name]


@pytest.fixture
def software(mine):
    """The module of the arm in software."""
    module = importlib.import_module(f"{NAME}.software_arm")
    module.SoftwareArm.made.clear()
    return module


@pytest.fixture
def run_software_arm(mine, software, monkeypatch, tmp_path, capfd):
    """Run the pipeline that is written on a software arm: the error, what was printed and when, the arm's way."""
    _, folder = mine
    trust_plugin(folder / "mine.py")
    calls = []

    def go(arm, *overrides):
        use(monkeypatch, software, arm)
        text = (folder / "point.toml").read_text()
        file = tmp_path / "point.toml"
        file.write_text(text.replace("seed = 1\n", f'seed = 1\nplugins = ["{folder / "mine.py"}"]\n'))
        error = None
        with simulated_time():
            monkeypatch.setattr(
                "palpate_engine.pipeline.live.arm_stop.call_for_stop", lambda text: calls.append((clock().now(), text))
            )
            try:
                run_pipeline(load_pipeline(file, [*SHORT, *overrides]), tmp_path / "out")
            except Exception as caught:
                error = caught
        return error, calls

    return go


def unlike(base, **methods):
    """A class of the arm in software with other methods."""
    return type("Unlike", (base,), {"made": [], **methods})


def use(monkeypatch, software, arm):
    """Let the driver make this arm."""
    monkeypatch.setattr(importlib.import_module(f"{NAME}.driver"), "SoftwareArm", arm)
    monkeypatch.setattr(software, "SoftwareArm", arm)


def listen(link):
    """Take the batches of a link in a thread, until they end; the list that what ends them is appended to."""
    said = []

    def hear():
        try:
            for _ in link.batches():
                pass
        except DeviceError as error:
            said.append(str(error))

    clock().thread(hear, "batches").start()
    return said
