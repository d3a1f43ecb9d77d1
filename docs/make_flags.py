"""The page of flags, from the registry; `make_reference` writes it."""

from palpate.flags import SEVERITIES
from palpate.registry import Registry

_HEAD = """# Flags

With this page you can look up what a flag says of a result and what to do; `palpate describe CODE` says the same.
The page is that of the installed plugins, which add flags by `palpate_flags`. How flags make the verdict of a value:
[verdict](../verdict.md).

- A flag states by how much what it names can move each value. It makes a value doubtful where that is unknown, or more
  than the value's combined standard uncertainty without the flag's own row of the budget.
- What moves less is a row of the budget, and stands under `immaterial` in `result.json`.
- A sign of another flag raises that one, and stands under its `evidence`: one cause, one flag.
- The terminal shows at most three flags of a track, those that move a value most. Numbers of a track that is `invalid`
  are not shown, and no statistic uses them.

How often flags are right: on [real logs](../../benchmarks/results/flags-real-logs.md), and on
[99 mistakes of laboratories](../../benchmarks/results/flags-measured.md).
"""


def page(registry: Registry) -> str:
    """The page, with every flag by severity and code."""
    lines = [_HEAD]
    for severity, words in SEVERITIES.items():
        lines += [f"## {severity}: {words}", "", "| code | what it says | what to do |", "|---|---|---|"]
        for code, entry in sorted(registry.flags.items()):
            if entry.meaning.severity == severity and not entry.meaning.evidence_of:
                lines.append(f"| `{code}` | {entry.meaning.meaning} | {entry.meaning.remedy} |")
        lines.append("")
    lines += ["## Signs", "", "| sign | of | what it says |", "|---|---|---|"]
    signs = {code: entry.meaning for code, entry in registry.flags.items() if entry.meaning.evidence_of}
    lines += [f"| `{code}` | `{signs[code].evidence_of}` | {signs[code].meaning} |" for code in sorted(signs)]
    lines.append("")
    return "\n".join(lines)
