"""Write results/messages.md, 25 mistakes and a broken plugin of each kind: ``python benchmarks/messages.py``."""

from __future__ import annotations

import contextlib
import io
import os
import re
import tempfile
from pathlib import Path

from palpate_engine.cli import main

ROOT = Path(__file__).parent.parent
_HEAD = """# Mistakes, and what palpate says of them

`benchmarks/messages.py` writes this page by making every mistake on `pipelines/point.toml`; a test makes them again.
Exit code 2 is a mistake of the user, 1 one that the user cannot mend.
"""
CHECK, RUN = ("check", "point.toml"), ("run", "point.toml", "--out", "out")

# What is wrong, the command, and what is replaced in the file by what.
MISTAKES: list[tuple[str, tuple[str, ...], tuple[str, str]]] = [
    ("a file that is not there", ("run", "pont.toml"), ("", "")),
    ("an unknown command", ("rnu", "point.toml"), ("", "")),
    ("an unknown option", ("run", "point.toml", "--outt", "x"), ("", "")),
    ("no TOML", CHECK, ("seed = 1", "seed = ")),
    ("a key twice", CHECK, ("seed = 1", "seed = 1\nseed = 2")),
    ("a misspelt table", CHECK, ("[alignment]", "[alignmnt]")),
    ("a misspelt key", CHECK, ('bias = "4 mm"', 'bais = "4 mm"')),
    ("a key that is missing", CHECK, ('bias = "4 mm"\n', "")),
    ("a misspelt type", CHECK, ('type = "point"', 'type = "piont"')),
    ("a part without a name", CHECK, ("[model.dr]", "[model]")),
    ("a part that is not there", CHECK, ('indenter = "tip"', 'indenter = "tipp"')),
    ("a channel that is not there", CHECK, ('"rig.tip.z"', '"rig.tpi.z"')),
    ("a track that is not there", (*CHECK, "--set", 'run.tracks=["dr/kinmatic"]'), ("", "")),
    ("a number without its unit", CHECK, ('bias = "4 mm"', "bias = 4")),
    ("a specimen in kPa without a unit", CHECK, ('elasticity = "112.5 kPa"', "elasticity = 112.5")),
    (
        "a first guess in kPa without a unit",
        (*CHECK, "--set", "estimator.kinematic.first_guess={elasticity=100}"),
        ("", ""),
    ),
    ("a mass in grams without a unit", (*CHECK, "--set", "alignment.tip_mass=140"), ("", "")),
    ("a unit of something else", CHECK, ('radius = "5 mm"', 'radius = "5 kPa"')),
    ("an unknown unit", CHECK, ('radius = "5 mm"', 'radius = "5 mmm"')),
    ("a number out of range", (*CHECK, "--set", "model.dr.poisson=0.7"), ("", "")),
    ("a text for a number", CHECK, ("seed = 1", 'seed = "one"')),
    ("an amplitude that leaves the skin", CHECK, ('amplitude = "1 mm"', 'amplitude = "5 mm"')),
    ("a folder that is not empty", ("run", "point.toml", "--out", "."), ("", "")),
    (
        "a parameter that the model does not have",
        (*CHECK, "--set", "estimator.kinematic.first_guess={stiffness=1}"),
        ("", ""),
    ),
    ("a log in place of a pipeline", ("run", "log.csv"), ("", "")),
]

_PLUGIN = "from palpate import {names}, plugin\n\n\n{body}\n\n\n@plugin\ndef {hook}():\n    return {{'own': {part}}}\n"


def _plugin(hook: str, part: str, names: str, body: str) -> str:
    return _PLUGIN.format(hook=hook, part=part, names=names, body=body)


_TIP = "class Own(Indenter):\n    '''A tip.'''"
_DEVICE = "class Own(Device):\n    '''A device.'''"
_FORCE = '''class Own(ContactModel):
    """A model."""

    parameters = (Parameter("elasticity", "E", "Pa", "of the material", role="elastic"),)

    def force(self, depth, rate, theta, memory=()):
        """Force [N]."""
        return {force}
'''
_FILTER = '''class Own(Estimator):
    """A filter."""

    def start(self, problem):
        """A tracker."""

        def step(moment):
            {step}

        return track_by_step(2, step)
'''
_MODEL = '\n[model.mine]\ntype = "own"\n'
_ESTIMATOR = '\n[estimator.mine]\ntype = "own"\n'
_TRACK = ("--set", 'run.tracks=["dr/mine"]', "--set", "trajectory.press.duration=1 s")

# What is broken, the plugin's file, what is added to the pipeline, the command.
PLUGINS: list[tuple[str, str, str, tuple[str, ...]]] = [
    ("a file that is not Python", "def palpate_models(:\n", "", CHECK),
    ("a file that raises when it is loaded", "1 / 0\n", "", CHECK),
    ("a hook that raises", _plugin("palpate_indenters", "1 / 0", "Indenter", ""), "", CHECK),
    ("a misspelt hook", _plugin("palpate_indenter", "Own", "Indenter", _TIP), "", CHECK),
    ("a plugin that offers nothing", "value = 1\n", "", CHECK),
    ("a tip without its formulas", _plugin("palpate_indenters", "Own", "Indenter", _TIP),
     '\n[indenter.mine]\ntype = "own"\n', CHECK),
    ("a model that answers NaN", _plugin("palpate_models", "Own", "ContactModel, Parameter",
     _FORCE.format(force="theta[0] * depth * float('nan')")), _MODEL, CHECK),
    ("a model whose force falls with depth", _plugin("palpate_models", "Own", "ContactModel, Parameter",
     _FORCE.format(force="-theta[0] * depth")), _MODEL, CHECK),
    ("a model that takes other arguments", _plugin("palpate_models", "Own", "ContactModel, Parameter",
     _FORCE.format(force="0.0").replace("rate, theta, memory=()", "theta")), _MODEL, CHECK),
    ("a filter that raises", _plugin("palpate_estimators", "Own", "Estimator, track_by_step",
     _FILTER.format(step="raise KeyError('lost')")), _ESTIMATOR, (*RUN, *_TRACK)),
    ("a filter that answers in a wrong form", _plugin("palpate_estimators", "Own", "Estimator, track_by_step",
     _FILTER.format(step="return 3")), _ESTIMATOR, (*RUN, *_TRACK)),
    ("a sink that lacks its method", _plugin("palpate_sinks", "Own", "Sink", "class Own(Sink):\n    '''A sink.'''"),
     '\n[sink.mine]\ntype = "own"\n', CHECK),
    ("a trajectory that lacks its methods", _plugin("palpate_trajectories", "Own", "Trajectory",
     "class Own(Trajectory):\n    '''A motion.'''"), '\n[trajectory.mine]\ntype = "own"\n', CHECK),
    ("a device that lacks its methods", _plugin("palpate_devices", "Own", "Device", _DEVICE),
     '\n[device.mine]\ntype = "own"\n', CHECK),
]  # fmt: skip


def said(arguments: tuple[str, ...]) -> tuple[int, str]:
    """Exit code of a command and what it says of the mistake."""
    out, errors = io.StringIO(), io.StringIO()
    code = 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        try:
            main(arguments)
        except SystemExit as end:
            code = int(end.code or 0)
    flag = re.search(
        r"^(invalid|doubtful): (.*?)(?=\n(note|and|written|invalid|doubtful)|\Z)",
        out.getvalue(),
        re.DOTALL | re.MULTILINE,
    )
    text = "\n".join([errors.getvalue().strip(), " ".join(flag[0].split()) if flag else ""]).strip()
    text = re.sub(r"/\S*?/(core|plugins)/", r"\1/", text)
    return code, re.sub(r"(?<!own)\.py, line \d+", ".py, line ...", text)  # in our files it changes


def pages() -> str:
    """The page."""
    lines = [_HEAD]
    example = (ROOT / "pipelines" / "point.toml").read_text(encoding="utf-8")
    for title, command, (old, new) in MISTAKES:
        lines += _section(title, command, {"point.toml": example.replace(old, new, 1) if old else example})
    lines += ["## Broken plugins", "", 'The pipeline names the file in `[run] plugins = ["own.py"]`.', ""]
    for title, plugin, tables, command in PLUGINS:
        text = example.replace("[run]\n", '[run]\nplugins = ["own.py"]\n', 1) + tables
        lines += _section(title, command, {"own.py": plugin, "point.toml": text})
    return "\n".join(lines)


def _section(title: str, command: tuple[str, ...], files: dict[str, str]) -> list[str]:
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        for name, text in {**files, "log.csv": "0,0\n"}.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        os.chdir(folder)
        try:
            code, text = said(command)
        finally:
            os.chdir(before)
        text = text.replace(f"{os.path.realpath(folder)}/", "").replace(f"{folder}/", "")
    shown = " ".join(f"'{word}'" if re.search(r"[^\w./=-]", word) else word for word in command)
    text_lines = [f"$ palpate {shown}", *text.splitlines()]
    return [f"### {title[0].upper()}{title[1:]}", "", "```", *text_lines, "```", "", f"Exit code {code}.", ""]


if __name__ == "__main__":
    (ROOT / "benchmarks" / "results" / "messages.md").write_text(pages(), encoding="utf-8")
