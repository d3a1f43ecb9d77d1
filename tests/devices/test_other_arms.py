"""Arms of other makers: what `palpate init --plugin arm` writes, its faults, and arms by their models on the twin."""

import importlib
import json
import sys

import numpy as np
import pytest
from palpate import clock
from palpate_commands.distribution import distribution
from palpate_engine import trust_plugin
from palpate_testing import ArmTest, check_device, simulated_time
from palpate_trajectories.point import Point

NAME = "palpate_mine"
PRESS = Point(bias=0.003, amplitude=0.001, clearance=0.003, duration=0.5, standstill=0.0)
WORK = {"origin": (0.45, 0.0, 0.1)}


@pytest.fixture(scope="module")
def mine(tmp_path_factory):
    """The package that is written, and its driver and arm in software; the folder of the distribution."""
    folder = tmp_path_factory.mktemp("arm") / "palpate-mine"
    for path, text in distribution("arm", "palpate-mine").items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
    (folder / "mine.py").write_text(f"from {NAME} import Arm, palpate_devices\n")
    sys.path.insert(0, str(folder))
    yield importlib.import_module(NAME), folder
    sys.path.remove(str(folder))
    for name in [name for name in sys.modules if name.partition(".")[0] == NAME]:
        del sys.modules[name]


@pytest.fixture
def software(mine):
    """The module of the arm in software."""
    module = importlib.import_module(f"{NAME}.software_arm")
    module.SoftwareArm.made.clear()
    return module


def arm_test(software):
    def cut():
        software.SoftwareArm.made[-1].plugged = False

    return ArmTest(tip=lambda: software.SoftwareArm.made[-1].place_now(), cut=cut)


def checked(device, software):
    with simulated_time():
        check_device(device, PRESS, listen=3.0, arm=arm_test(software))


@pytest.mark.gate
@pytest.mark.slow
def test_what_is_written_passes_the_checks(mine, software):
    checked(mine[0].Arm(host="127.0.0.1", work=WORK), software)


def unlike(base, **methods):
    """A class of the arm in software with other methods."""
    return type("Unlike", (base,), {"made": [], **methods})


def no_stop(base):
    """It goes on down at 5 mm/s once it is stopped."""

    def stop(self):
        self.creeps = self.commanded > 0.0  # taken over, it stands

    def advance(self):
        if getattr(self, "creeps", False):
            pose, _ = self.model.tip(self.target.tolist(), self.tool)
            pose[2, 3] -= 0.005 * (clock().now() - self.now)
            self.target, self.commanded = self.model.joints_at(pose, self.tool, self.target), clock().now()
        base.advance(self)

    return unlike(base, stop=stop, advance=advance)


def no_setpoints(base):
    return unlike(base, go_to=lambda self, pose: True)


def no_way_up(base):
    """It does not go up once it was down."""

    def go_to(self, pose):
        self.lowest = min(getattr(self, "lowest", np.inf), pose[2])
        deep = self.lowest < 0.1005
        return base.go_to(self, [*pose[:2], self.lowest if deep else pose[2], *pose[3:]])

    return unlike(base, go_to=go_to)


def commands_for_poses(base):
    """What it reports is what it was commanded, also without a link."""

    def state(self):
        self.plugged_for_real, self.plugged = self.plugged, True
        found = base.state(self)
        self.plugged = self.plugged_for_real
        return found._replace(q=self.target.tolist())

    return unlike(base, state=state)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (no_stop, "does not obey: 1 s after `stop` its tip still moves"),
        (no_setpoints, "does not change in any digit|has moved by|does not follow"),
        (no_way_up, "does not retract|does not follow|has moved by"),
        (commands_for_poses, "is its command, in every digit"),
    ],
)
def test_a_driver_with_a_fault_fails_the_checks(mine, software, monkeypatch, fault, words):
    faulty = fault(software.SoftwareArm)
    monkeypatch.setattr(importlib.import_module(f"{NAME}.driver"), "SoftwareArm", faulty)
    monkeypatch.setattr(software, "SoftwareArm", faulty)
    with pytest.raises(AssertionError, match=words):
        checked(mine[0].Arm(host="127.0.0.1", work=WORK), software)


VARIANTS = """
from palpate import plugin
from palpate_mine import MODEL, Arm
from tests.kit.test_arm_model import panda


class Soft(Arm):
    @property
    def controller_stiffness(self):
        return 2500.0


class Late(Arm):
    @property
    def twin_settings(self):
        return {**super().twin_settings, "arm.lag": "0.15"}


class Seven(Arm):
    maker = "panda"
    joint_names = panda().joints
    posture = (0.0, -0.35, 0.0, -2.3, 0.0, 1.95, 0.785)

    @property
    def arm_model(self):
        return panda()


@plugin
def palpate_devices():
    return {"mine": Arm, "soft": Soft, "late": Late, "seven": Seven}
"""


@pytest.fixture
def rehearse(mine, tmp_path, palpate):
    """Rehearse the pipeline that is written, with another arm: what the command says, and result.json as a table."""
    plugin = tmp_path / "variants.py"
    plugin.write_text(VARIANTS)
    trust_plugin(plugin)

    def run(arm, *overrides, faults=()):
        text = (mine[1] / "point.toml").read_text().replace("seed = 1\n", f'seed = 1\nplugins = ["{plugin}"]\n')
        (tmp_path / "point.toml").write_text(text)
        words = ["--specimen", "elasticity=60 kPa", "--specimen", "viscosity=150 Pa*s"]
        words += [word for override in (f"device.arm.type={arm}", *overrides) for word in ("--set", override)]
        words += [word for fault in faults for word in ("--fault", fault)]
        done = palpate("rehearse", "point.toml", *words, "--out", "out")
        file = tmp_path / "out" / "result.json"
        return done, json.loads(file.read_text()) if file.exists() else None

    return run


@pytest.mark.slow
@pytest.mark.parametrize("arm", ["mine", "soft", "late", "seven"])
def test_try(rehearse, arm):
    done, table = rehearse(arm, "trajectory.press.duration=3 s")
    print(done.stdout, done.stderr)
    print(json.dumps(table["run"]["health"]["arm"] if table else None, indent=1)[:3000])
    assert 0
