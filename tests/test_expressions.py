"""Every regular expression of the product takes linear time: texts are tried that make one slow that goes back."""

import ast
import re
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CALLS = {"compile", "match", "search", "fullmatch", "sub", "findall", "finditer", "split"}
LENGTH = 20_000  # a quadratic expression takes some four seconds for it, a linear one a millisecond
LIMIT = 0.5  # [s] of processor time


def expressions(folder):
    """Where, and which, of all literal expressions in calls of `re`."""
    found = []
    for path in sorted((ROOT / folder).rglob("*.py")):
        text = path.read_text()
        for node in ast.walk(ast.parse(text)) if "re." in text and "import re\n" in text else ():
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Attribute)
                and node.func.attr in CALLS
                and isinstance(node.func.value, ast.Name)
                and node.func.value.id == "re"
                and node.args
                and isinstance(node.args[0], ast.Constant)
            ):
                flags = re.MULTILINE if "MULTILINE" in ast.dump(node) else 0
                found.append((f"{path.relative_to(ROOT)}:{node.lineno}", node.args[0].value, flags))
    return found


def attacks(pattern):
    """Long texts of few kinds of characters, those of the expression among them, whose end fits nothing."""
    text = pattern if isinstance(pattern, str) else pattern.decode("latin-1")
    literal = sorted({c for c in re.sub(r"\\[a-zA-Z]|\(\?P?<?\w*>?", "", text) if c.isprintable()} | set("1a \n=_-.[("))
    units = [
        *literal,
        *(a + b for a in "1a =\n-.[" for b in literal if a != b),
        "1e",
        "1.1",
        "a.b",
        "[1]",
        " \n",
        "- a\n",
    ]
    words = re.findall(r"[A-Za-z_]{3,}", text)
    for unit in [*units, *words]:
        body = unit * (LENGTH // len(unit))
        for end in ("\x00", "!\n\x00"):
            yield body + end
            for word in words[:2]:
                yield word + body + end


@pytest.mark.slow
@pytest.mark.parametrize("folder", ["core/palpate", "core/palpate_kit", "plugins"])
def test_every_expression_is_linear(folder):
    found = expressions(folder)
    assert found
    for where, pattern, flags in found:
        expression = re.compile(pattern, flags)
        for attack in attacks(pattern):
            text = attack if isinstance(pattern, str) else attack.encode("latin-1")
            for way in (expression.match, expression.fullmatch):
                began = time.process_time()
                way(text)
                took = time.process_time() - began
                assert took < LIMIT, f"{where}: {pattern!r} takes {took:.1f} s for {text[:20]!r}..."
