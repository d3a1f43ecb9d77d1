"""A person at the twin for tests: goes through an acceptance by its prompts, with the twin's console for hands."""

import os
import re
import subprocess

from tests import processes

ACTS = {
    "press the emergency stop": "estop",
    "open the safeguard": "safeguard-stop",
    "pull the cable": "unplug",
}
_ENTER = "then press Enter"


class Person:
    """Reads what the protocol says, and does it to the twin."""

    def __init__(self, twin, folder, *words, before=()):
        sets = [f"device.arm.host={twin.host}", f"device.sensor.port={twin.port}", *twin._overrides]
        words = [*words, *(word for entry in sets for word in ("--set", entry)), "--out", str(folder)]
        self._twin, self._before = twin, before
        self._process = processes.start(
            processes.PALPATE, "acceptance", *words, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, env={**os.environ, "COLUMNS": "140"},
        )  # fmt: skip
        self.said, self._top = "", 0.0

    def go_through(self, answers=1000):
        """Exit code and standard output of the whole protocol, or of what there is of it after some answers."""
        act, begin = None, 0
        while data := os.read(self._process.stderr.fileno(), 4096):
            self.said += data.decode()
            news = self.said[begin:]
            if heights := re.search(r"between heights of [-\d.]+ and ([-\d.]+) mm", news):
                self._top = float(heights[1]) / 1e3 - 0.001
            for words, line in ACTS.items():
                if f"  {words}" in news:
                    act = line
            if act is not None and ("while the tip moves" in news or re.search(r"^  NOW$", news, re.MULTILINE)):
                if "while" in news:
                    self._twin.wait(lambda state: state["height"] > self._top)  # the strokes begin there
                    self._twin.wait(lambda state: state["height"] < self._top - 0.005)
                self._twin.fault(act)
                act, begin = None, len(self.said)
            elif _ENTER in news:
                self._twin.fault("restore")
                for line in self._before:
                    self._twin.fault(line)
                begin = len(self.said)
                answers -= 1
                if answers < 0:
                    self._process.stdin.close()
                else:
                    self._process.stdin.write(b"\n")
                    self._process.stdin.flush()
        out = self._process.stdout.read().decode()
        for pipe in (self._process.stdin, self._process.stdout, self._process.stderr):
            pipe.close()
        return self._process.wait(60), out
