"""The messages that benchmarks/results/faults.md quotes are those of the code."""

import ast
import re
from functools import cache

PAGE = "benchmarks/results/faults.md"
CODE = (
    "core/palpate/*.py",
    "core/palpate_engine/pipeline",
    "core/palpate_kit/acquisition",
    "core/palpate_kit/protocols",
)
CODE += ("core/palpate_kit/kinematics", "core/palpate_arms", "plugins/devices")
# What other programs say: the client library, the system, a reference to the page.
OTHERS = ("The following variables was not found", "already in use", "Failed to start control script", "No such file")
PLAIN = ("the same", "see", "it runs", "half a packet")


def quoted(root):
    """The second cell of each row of the tables of faults."""
    seen, inside = [], False
    for line in (root / PAGE).read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        if len(cells) < 4:
            inside = False
        elif cells[2] == "what the user sees":
            inside = True
        elif inside and not set(cells[2]) <= {"-"}:
            seen.append(cells[2])
    return seen


def phrases(cell):
    """The words of a cell that must be the code's: between numbers, names in capitals, quotes and alternatives."""
    text = re.sub(r"\([^)]*\)|'[^']*'|`[^`]*`|\"[^\"]*\"|\b[A-Z]{2,}(_[A-Z]+)*\b|\b[a-z]+([._][a-z]+)+\b", "|", cell)
    parts = re.split(r"\||\d[\d.]*( %| mm| ms| s\b| N\b)?|\.\.\.|; |: |, or |\bor\b", text)
    found = (part.strip(" ,;:.") for part in parts if part)
    return [part for part in found if len(part.split()) >= 3 and not part.startswith((*OTHERS, *PLAIN))]


@cache
def constants(root):
    """Every text of the code; what it fills in is a bar."""
    texts = []
    for name in CODE:
        for path in root.glob(name) if name.endswith(".py") else (root / name).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.JoinedStr):
                    parts = (part.value if isinstance(part, ast.Constant) else "|" for part in node.values)
                    texts.append("".join(map(str, parts)))
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    texts.append(node.value)
    return "\n".join(texts)


def unknown(phrase, code):
    """The rest of a phrase that is not made of texts of the code, each of two words or more but the last."""
    words = phrase.split()
    while words:
        known = next((n for n in range(len(words), min(len(words) - 1, 1), -1) if " ".join(words[:n]) in code), 0)
        if not known:
            return " ".join(words)
        words = words[known:]
    return ""


def test_the_tables_are_found(root):
    cells = quoted(root)
    assert len(cells) > 40
    assert phrases("the speed slider was moved to 60 %; set it back ...") == [
        "the speed slider was moved to",
        "set it back",
    ]


def test_quoted_messages_are_those_of_the_code(root):
    code = constants(root)
    missing = {
        phrase: unknown(phrase, code) for cell in quoted(root) for phrase in phrases(cell) if unknown(phrase, code)
    }
    assert not missing
