"""A study from its files to its archive: each command with the words that it prints."""

import json
import re
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

from same_scenes.command import PALPATE
from same_scenes.files import press, write_curves, write_shake, write_stack, write_sweep, write_table

OF_TIME = re.compile(r".*, after \d+ s|.*\bcreated\b.*")  # progress of a command over 10 s, and a date
READER = """
[device.log]
type = "csv-replay"
file = "study/control_a1.csv"
time = { column = "time_s", unit = "s" }
columns = { force = { column = "force_N", unit = "N" }, z = { column = "height_mm", unit = "mm" } MORE }
[alignment]
force = { channel = "log.force", uncertainty = "0.2 ms" }
position = "log.z"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
[estimator.fit]
type = "casadi-fit"
"""
SHAKE = """
[device.log]
type = "csv-replay"
file = "shake.csv"
time = { column = "time_s", unit = "s" }
[device.log.columns]
force = { column = "force_N", unit = "N" }
z = { column = "height_m", unit = "m" }
v = { column = "velocity_m_s", unit = "m/s" }
[calibration]
frequencies = ["5 Hz"]
[alignment]
force = "log.force"
position = "log.z"
velocity = "log.v"
"""
DESK = """
import json, sys
from pathlib import Path
from palpate_desk.curve_answers import curve_answer, reader_with_model
from palpate_desk.desk import Desk
desk = Desk(Path("refit"))
desk.set("estimator.fit.segment=load", "curve=study/control_a2.csv")
answers = []
for name in ("study/control_a2.csv", "study/b/control_b2.csv"):
    reader, curve = desk.reader(name), desk.curve(name)
    other = reader_with_model(reader, "kelvin-voigt")
    answers += [curve_answer(one, curve, fitting) for one, fitting in ((reader, True), (other, True), (reader, False))]
desk.take_rows(answers[0].rows)
desk.compact()
print(json.dumps([[a.settings, a.rows, a.facts, a.error, a.columns.tolist()] for a in answers]))
"""
PYTHON = """
import json
import palpate
record = palpate.read("study/treated_a1.csv")
fit = palpate.fit(record, tip="sphere 4 mm", model="dr")
frame = palpate.fit_folder("study", settings=["estimator.fit.segment=load"])
print(json.dumps([str(fit.to_dict()), frame.to_csv()]))
"""


@dataclass
class Study:
    """A folder in which commands are typed, with what each has printed."""

    folder: Path
    printed: dict[str, dict[str, object]] = field(default_factory=dict)

    def type(self, *arguments: str) -> None:
        """Type a command."""
        self._run(" ".join(arguments), [*PALPATE, *arguments])

    def execute(self, name: str, program: str) -> None:
        """Execute a program in Python."""
        self._run(name, [sys.executable, "-c", program])

    def _run(self, name: str, words: list[str]) -> None:
        done = subprocess.run(words, cwd=self.folder, capture_output=True, text=True, check=False)
        texts = [
            [line for line in text.replace(str(self.folder), "").splitlines() if not OF_TIME.fullmatch(line)]
            for text in (done.stdout, done.stderr)
        ]
        key = name if name not in self.printed else f"{name} ({len(self.printed)})"
        self.printed[key] = {"code": done.returncode, "output": texts[0], "errors": texts[1]}


def run_study(folder: Path) -> None:
    """Type every command of the study; what they print is in ``printed.json``."""
    folder.mkdir(parents=True)
    study = Study(folder.resolve())
    write_files(folder)
    fit_files(study)
    fit_again(study)
    share(study)
    study.type("material", "fit", "sweep.csv", "--modulus", "shear", "--json", "--out", "material")
    study.type("material", "sweep.csv", "--modulus", "shear", "--json")
    study.type("calibrate", "shake.toml", "--yes", "--json", "--out", "measured.toml")
    study.execute("desk", DESK)
    study.execute("python", PYTHON)
    (folder / "printed.json").write_text(json.dumps(study.printed, indent=1))


def write_files(folder: Path) -> None:
    """Write the files of the study."""
    write_curves(folder / "study")
    write_stack(folder / "stack.csv")
    write_sweep(folder / "sweep.csv")
    write_shake(folder / "shake.csv")
    (folder / "reader.toml").write_text(READER.replace(" MORE", ""))
    more = ', curve = { column = "curve", unit = "1" }'
    (folder / "stack.toml").write_text(READER.replace(" MORE", more).replace("study/control_a1.csv", "stack.csv"))
    (folder / "shake.toml").write_text(SHAKE)


def fit_files(study: Study) -> None:
    """Fit files by facts, by options and by a pipeline, in a folder and alone."""
    study.type("info", "study", "--suggest", "--json")
    study.type("fit", "study", "--out", "tip", "--details")
    study.type("fit", "study/control_a1.csv", "study/treated_a1.csv", "--out", "two", "--json")
    study.type("fit", "study/treated_a2.csv", "--tip", "sphere 5 mm", "--model", "kelvin-voigt", "--out", "one")
    study.type("fit", "study", "--tip", "cone 60 deg", "--by", "(control|treated)", "--no-refit", "--out", "named")
    study.type("fit", "study", "--by", "treatment", "--thickness", "8 mm", "--jobs", "2", "--out", "by")
    study.type("fit", "--each", "study", "--pipeline", "reader.toml", "--out", "each", "--json")
    study.type("fit", "--each", "stack.csv", "--by", "curve", "--pipeline", "stack.toml", "--out", "stack")
    files = ("study/control_a1.csv", "study/treated_a1.csv")
    study.type("fit", *files, "--pipeline", "reader.toml", "--no-pictures", "--out", "whole")
    study.type("fit", files[1], "--pipeline", "tip/pipeline.toml", "--no-pictures", "--out", "page")


def fit_again(study: Study) -> None:
    """Fit folders of fits again, with new files, other settings of all curves and of some, and facts."""
    study.type("fit", "tip")
    write_table(study.folder / "study" / "control_c1.csv", press(10, 26e3))
    (study.folder / "study" / "no_curve.csv").write_text("no,curve\nat,all\n")
    study.type("fit", "tip", "--json")
    (study.folder / "study" / "no_curve.csv").unlink()
    study.type("fit", "tip", "--where", "curve=study/control_a1.csv", "--set", "estimator.fit.segment=load")
    study.type("fit", "tip", "--tip", "sphere 4.9 mm", "--delay", "1 ms +- 0.2 ms", "--no-refit")
    study.type("fit", "tip", "--details")
    study.type("fit", "tip", "--unset", "rig.delay", "--model", "kelvin-voigt", "--json")
    study.type("fit", "tip", "--where", "verdict:nonsense")
    study.type("fit", "named", "--groups", "groups.csv")
    study.type("fit", "study", "--out", "refit", "--no-refit")
    study.type("fit", "choose", "by", "--models", "dr,kelvin-voigt", "--where", "curve=study/control_a2.csv", "--json")


def share(study: Study) -> None:
    """Compare groups, write all values, mark a curve, pack the study and verify the archive."""
    study.type("repeat", "by", "--by", "treatment", "--unit", "animal", "--json")
    study.type("repeat", "by", "--by", "treatment", "--where", "E>13")
    study.type("repeat", "by", "tip", "whole", "--table", "values.csv")
    study.type("repeat", "review", "by", "--reject", "study/control_a2.csv", "--reason", "the tip slipped")
    study.type("map", "by", "--json")
    study.type("pack", "by", "--by", "treatment", "--out", "by.zip")
    study.type("verify", "by.zip", "--json")
