"""A study of curves in two groups, made by physics, and what its commands print."""

import csv
import html
import re
import shlex
from itertools import pairwise
from pathlib import Path

import numpy as np

from tests.command import call

VALUES = {  # of the user, in place of VALUE
    "--thickness": "12 mm", "--tip": "sphere 5 mm", "--poisson": "0.5", "--base": "bonded", "--delay": "0 ms +- 1 ms",
    "--tare": "free-air",
}  # fmt: skip


def press(seed, elasticity, thickness, n=250):
    """Time [s], force [N] and height [mm] of a press at 1.5 mm/s on a bonded layer [m], held at the end."""
    random = np.random.default_rng(seed)
    time = np.arange(n) / 125
    depth = np.minimum(2.5e-3, 1.5e-3 * time) - 0.5e-3
    contact = np.maximum(depth, 0.0)
    share = np.sqrt(5e-3 * contact) / thickness
    stiffer = 1 + 1.133 * share + 1.497 * share**2 + 1.469 * share**3 + 0.755 * share**4
    force = 16 / 9 * elasticity * np.sqrt(5e-3) * contact**1.5 * stiffer + 2e-3 * random.standard_normal(n)
    return np.column_stack([time, force, -1e3 * depth + 2e-4 * random.standard_normal(n)])


class Study:
    """The folder of a study, and what its commands have printed."""

    def __init__(self, folder, each):
        self.folder, self.each = folder, each
        (folder / "study").mkdir()
        self.heights = {}
        for group, (name, elasticity) in enumerate((("ctrl", 15e3), ("treat", 22e3))):
            for number in range(each):
                height = 8e-3 + 6e-3 * number / each
                file = f"{name}_{number + 1:02d}.csv"
                table = press(100 * group + number, elasticity * (1 + 0.03 * (number % 3)), height)
                head = "time_s,force_N,height_mm"
                np.savetxt(folder / "study" / file, table, "%.9g", ",", header=head, comments="")
                self.heights[file] = height
        self.printed = self("fit", "study", "--tip", "sphere 5 mm", "--by", "(ctrl|treat)", "--out", "fits")

    def __call__(self, *words):
        words = [*words, "--jobs", "1"] if words[0] == "fit" and not {"--pipeline", "choose"} & {*words} else words
        return call(*words, cwd=self.folder, COLUMNS="79")

    def rows(self, table="fits"):
        with (self.folder / table / "fits.csv").open(newline="") as file:
            return {Path(row["curve"]).stem: row for row in csv.DictReader(file)}

    def text(self, *words):
        done = self(*words)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def page(self, name, *words):
        """The text of a page, its blanks as one."""
        self.text("report", *words, "--out", name)
        return words_of_page((self.folder / name).read_text())


def words_of_page(page):
    page = re.sub(r"<(script|style|svg).*?</\1>", " ", page, flags=re.S)
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", page)).replace("\xa0", " ").split())


def options(text):
    """Options in a line that states facts, each with a value of the user's."""
    return [word for option in re.findall(r"(--[a-z-]+) VALUE", text) for word in (option, VALUES[option])]


def commands(text):
    """Commands of a screen as words, each once, with values of the user's in place of VALUE."""
    lines = re.findall(r"(?:^|[ :`])(palpate [a-z][^\n`]*)", text, re.MULTILINE)
    parts = [part for line in lines for part in line.split(" && ")]
    for command in dict.fromkeys(parts):
        words = shlex.split(command)[1:]
        yield [VALUES[last] if word == "VALUE" else word for last, word in pairwise(["", *words])]
