"""An acceptance on a twin in simulated time: the run of strokes is a thread, and a person does what the prompts say."""

from palpate import clock
from palpate_commands.acceptance.protocol import AcceptanceGuide, AcceptanceProtocol
from palpate_commands.acceptance.rehearsal import ThreadJob
from palpate_commands.acceptance.steps import all_visits

ACTS = {"press the emergency stop": "estop", "open the safeguard": "safeguard-stop", "pull the cable": "unplug"}


class Person:
    """Does to the twin what the protocol asks for."""

    def __init__(self, twin, faults):
        self._twin, self._faults, self._act = twin, faults, None
        self.said = []

    def say(self, text):
        self.said.append(text)
        for words, line in ACTS.items():
            if f"  {words}" in text:
                self._act = line
        if "while the tip moves" in text:
            clock().thread(self._soon, "hand").start()
        elif text == "  NOW" and self._act is not None:
            self._twin.fault(self._act)
            self._act = None

    def _soon(self):
        self._twin.wait(lambda state: state["height"] > 0.017)  # the strokes begin there
        self._twin.wait(lambda state: state["height"] < 0.012)
        self._twin.fault(self._act)
        self._act = None

    def ask(self, text):
        self.said.append(text)
        for line in ("restore", *self._faults):
            self._twin.fault(line)


def go_through(twin, folder, names, faults=(), overrides=()):
    """Outcomes by step, and what the protocol said."""
    pipeline, person = twin.pipeline(*overrides), Person(twin, faults)
    start = lambda run: ThreadJob(pipeline, run)  # noqa: E731
    protocol = AcceptanceProtocol(pipeline, folder, AcceptanceGuide(person.say, person.ask), start)
    visits = [visit for visit in all_visits() if visit.name in names]
    protocol.refuse(visits)
    return {outcome.visit.name: outcome for outcome in protocol.outcomes(visits)}, person.said
