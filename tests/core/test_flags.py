"""Flags: each is registered, each that is registered is raised, and a track's verdict is the worst of them."""

import ast
import importlib.util
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from palpate import Estimates, Flag, FlagMeaning
from palpate.errors import PluginError
from palpate.flags import SEVERITIES, VERDICTS, verdict
from palpate.registry import load

ROOT = Path(__file__).parents[2]
RAISERS = ("Flag", "NotFitted")  # what takes a code as its first argument


@cache
def raised():
    """Code -> places where it is raised; None for a code that is no literal."""
    found = {}
    for path in sorted([*(ROOT / "core").rglob("*.py"), *(ROOT / "plugins").rglob("*.py")]):
        text = path.read_text()
        for node in ast.walk(ast.parse(text)) if any(f"{name}(" in text for name in RAISERS) else ():
            if isinstance(node, ast.Call) and getattr(node.func, "id", None) in RAISERS and node.args:
                code = node.args[0].value if isinstance(node.args[0], ast.Constant) else None
                found.setdefault(code, []).append(f"{path.relative_to(ROOT)}:{node.lineno}")
    return found


REGISTRY = load()
PASSED_ON = (
    "refusal.py",
    "result_file.py",
    "device_flags.py",
    "palpate_ros2/sink.py",
    "parameter_values.py",
)  # files that make flags of codes given to them
REPORTED = {"lost-periods": "core/palpate_arms/arm_link.py"}  # by the health of a device, which names the code


def test_every_flag_that_is_raised_is_registered():
    missing = {code: places for code, places in raised().items() if code and code not in REGISTRY.flags}
    assert not missing
    unknown = [place for place in raised().get(None, []) if not any(f"/{name}:" in place for name in PASSED_ON)]
    assert not unknown, "a flag's code is a literal, so that this test sees it"


def test_every_registered_flag_is_raised():
    by_signs = {REGISTRY.meanings[code].evidence_of for code in raised() if code in REGISTRY.meanings}
    assert set(REGISTRY.flags) - set(raised()) - by_signs == REPORTED.keys()
    assert all(f'"{code}"' in (ROOT / path).read_text() for code, path in REPORTED.items())


def test_every_sign_is_of_a_flag():
    signs = [meaning.evidence_of for meaning in REGISTRY.meanings.values() if meaning.evidence_of]
    assert not [code for code in signs if REGISTRY.meanings[code].evidence_of]
    assert len(REGISTRY.meanings) - len(signs) <= 75, "what a user would not do otherwise is a sign, no flag of its own"


@pytest.mark.parametrize("code", sorted(REGISTRY.flags))
def test_every_flag_says_what_it_means_and_what_to_do(code):
    meaning = REGISTRY.flags[code].meaning
    assert meaning.severity in SEVERITIES
    assert meaning.meaning.endswith(".")
    assert meaning.remedy.endswith(".") or meaning.evidence_of


def test_the_page_of_flags_is_made_from_the_registry():
    spec = importlib.util.spec_from_file_location("make_flags", ROOT / "docs" / "make_flags.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    page = module.page(REGISTRY)
    assert [code for code in REGISTRY.flags if f"| `{code}` |" not in page] == []


def test_a_verdict_is_the_worst_severity():
    flags = REGISTRY.judged([Flag("touched-again", "x"), Flag("lack-of-fit", "x"), Flag("no-contact", "x")])
    assert [flag.severity for flag in flags] == ["note", "doubtful", "invalid"]
    assert [verdict(flags[:n]) for n in range(4)] == list(VERDICTS)
    assert verdict(REGISTRY.judged([Flag("of-nobody", "x")])) == "doubtful"


def test_a_flag_is_no_text():
    with pytest.raises(TypeError, match="Flag"):
        Estimates(*np.zeros((8, 0)), flags=("not-fitted: no such thing",))


PLUGIN = """
from palpate import FlagMeaning, plugin

@plugin
def palpate_flags():
    return {%r: FlagMeaning("invalid", "It is so.", "Do this.")}
"""


def test_a_flag_of_a_plugin_in_a_file(palpate, tmp_path):
    (tmp_path / "own.py").write_text(PLUGIN % "own-flag")
    assert load([tmp_path / "own.py"]).flags["own-flag"].meaning == FlagMeaning("invalid", "It is so.", "Do this.")
    described = palpate("describe", "own-flag", "--plugin", "own.py").stdout
    assert "own-flag: a flag, invalid (the track's numbers must not be used)" in described
    assert "It is so.\nWhat to do: Do this." in described
    assert "did you mean 'not-fitted'?" in palpate("describe", "not-fited").stderr


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (PLUGIN % "diverged", r"flag 'diverged' is claimed by two plugins: palpate and .*own\.py"),
        (PLUGIN % "misfit", r"claimed by two plugins: palpate .* \(fits\) and .*own\.py"),
        (
            PLUGIN.replace('FlagMeaning("invalid", "It is so.", "Do this.")', "'invalid'") % "x",
            "is not of kind FlagMeaning",
        ),
    ],
)
def test_what_is_no_registration_is_refused(tmp_path, text, problem):
    (tmp_path / "own.py").write_text(text)
    with pytest.raises(PluginError, match=problem):
        load([tmp_path / "own.py"])


def test_the_result_holds_severities_and_verdict(palpate, point_pipeline, tmp_path):
    short = ("--set", "trajectory.press.duration=1 s", "--set", "alignment.touch_force=90 N")
    done = palpate("run", point_pipeline, "--out", tmp_path / "out", *short)
    track = json.loads((tmp_path / "out" / "result.json").read_text())["tracks"]["dr/ekf"]
    assert {"code", "message", "severity", "remedy", "moves"} >= set(track["flags"][0]) >= {"code", "severity"}
    assert track["verdict"] == "invalid"
    assert "no-contact" in [flag["code"] for flag in track["flags"] if flag["severity"] == "invalid"]
    assert "invalid[no-contact]" in done.stdout


def test_every_threshold_of_the_page_says_what_it_decides():
    spec = importlib.util.spec_from_file_location("make_thresholds", ROOT / "docs" / "make_thresholds.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    thresholds = [threshold for package in module.PACKAGES for threshold in module.thresholds(package)]
    assert len(thresholds) > 150
    assert [threshold for threshold in thresholds if len(threshold.meaning.split()) < 2] == []
    rows = [line for line in module.page().splitlines() if line.startswith("| `")]
    assert len(rows) == len(thresholds)
    assert {row.count(" | ") for row in rows} == {5}
    assert {row.rpartition(" | ")[2].split(",")[0].strip(" |") for row in rows} == {"law", "measurement", "choice"}
