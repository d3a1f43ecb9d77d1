"""The words that may reach a screen: verdicts, heads of findings with their codes and causes; and phrases that may not.

A word that is new on a screen of the study is entered here, after somebody has read it there.
"""

import re

FACTS = ("thickness", "delay", "tare", "mass", "poisson", "level", "mount", "rate", "position", "tip")
VERDICT = re.compile(rf"(?:good|doubtful|not determined|invalid|needs? (?:an? )?(?:{'|'.join(FACTS)}))\b")
FOLLOWERS = ("estimator", "over", "elasticity", "viscosity", "surface")  # behind a number without a verdict
HEADS = {"doubtful", "not determined", "invalid", "note"}
CODES = {"lack-of-fit", "undetermined", "not-converged", "model-discrepancy"}
CAUSES = {"thickness", "tip", "model-discrepancy", "noise", "second contact", "settling"}
# Words of older screens, keys of a pipeline in place of a fact, and sentences without a subject.
BANNED = (
    r"device\.\w+\.columns\.\w+\.unit", r"holds if", r"would look like", r"note: undetermined", r"as in its upper band",
    r"\busable\b", r"trust it", r"hang together", r"knows of it", r"Pa\*s", r"within twice its ± of none", r"wrong-tip",
    r"\d\.\d+e[+-]\d\d (%|ms)",
)  # fmt: skip
_HEAD = re.compile(r"\b(doubtful|not determined|invalid|note|good|[a-z]+)\[([a-z0-9-]+)(?:: ([a-z ,.-]+))?\]")
_COUNTS = re.compile(r"\b(?:E|eta): (?=\d+ )")
_BESIDE = re.compile(r"± [\d.]+ (?:kPa|Pa s) (?=[a-z])")


def banned_phrases(text):
    """Phrases of a screen that no screen may have."""
    return [phrase for phrase in BANNED if re.search(phrase, text)]


def unknown_heads(text):
    """Heads such as "doubtful[lack-of-fit: thickness]" of which a word is not in the lists."""
    heads = _HEAD.findall(" ".join(text.split()))
    return [head for head in heads if head[0] not in HEADS or head[1] not in CODES or head[2] not in {"", *CAUSES}]


def unknown_verdicts(text):
    """What is counted in a last line, or stands behind a value, and is no verdict."""
    line = " ".join(text.split())
    return [*_unknown_counts(line), *_unknown_words(line)]


def _unknown_counts(line):
    for value in _COUNTS.finditer(line):
        rest = line[value.end() :]
        while (count := re.match(r"(?:, )?\d+ ", rest)) is not None:
            rest = rest[count.end() :]
            if (verdict := VERDICT.match(rest)) is None:
                yield rest[:40]
                break
            rest = rest[verdict.end() :]


def _unknown_words(line):
    for value in _BESIDE.finditer(line):
        rest = line[value.end() :]
        if VERDICT.match(rest) is None and not rest.startswith(FOLLOWERS):
            yield rest[:40]
